"""Collected episodes once more on stock robosuite: its stepping, and its renderer for the kept frames. No writing."""

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from benchmarks.stock_world import StockWorld
from schemas import mcap_topics
from schemas.mcap_files import read_messages, read_metadata
from stages.collect.config import CollectStageConfig
from stages.sim.camera import CameraPose
from stages.sim.canvas import OPTICAL_TO_GL

_CAMERA = "frontview"


@dataclass(frozen=True)
class CollectedEpisode:
    """What an episode's file says was done and seen."""

    task: str
    initial_state: np.ndarray  # (k,)
    actions: np.ndarray  # (steps, action_dim) float32
    qpos: dict[int, np.ndarray]  # step → generalised positions (nq,) of each kept frame
    images: list[np.ndarray]  # (H, W, 3) uint8, in the order of the steps
    camera: CameraPose


def read_collected(path: Path) -> CollectedEpisode:
    """All that it takes to make the episode again."""
    by_topic: dict[str, list] = {}
    for topic, _, message in read_messages(path):
        by_topic.setdefault(topic, []).append(message)
    metadata, states = read_metadata(path), by_topic[mcap_topics.SIM_STATE]
    pose = mcap_topics.placement(by_topic[mcap_topics.TF][0], mcap_topics.CAMERA_FRAME)
    kept = set(map(int, metadata["kept_steps"].strip("[]").split(",")))
    return CollectedEpisode(
        task=metadata["task"],
        initial_state=np.array(states[0].integration_state),
        actions=np.array([message.values for message in by_topic[mcap_topics.ACTION]], np.float32),
        qpos={state.step: np.array(state.qpos) for state in states if state.step in kept},
        images=[np.asarray(Image.open(io.BytesIO(m.data))) for m in by_topic[mcap_topics.CAMERA_IMAGE]],
        camera=CameraPose.from_quaternion(*pose),
    )


class StockCollector:
    """One process of stock robosuite, as a user has it."""

    def __init__(self, config: CollectStageConfig) -> None:
        self._camera = config.camera
        self._world = StockWorld(config.world, "reach", has_offscreen_renderer=True)  # the scene is the same in lift

    def collect(self, episode: CollectedEpisode) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Image (H, W, 3) uint8 and generalised positions (nq,) of each kept frame."""
        world, size = self._world, self._camera.image_size
        simulation, world.task = world.environment.sim, episode.task
        simulation._render_context_offscreen.gl_ctx.make_current()  # ours may have drawn in this process since
        self._place_camera(world, episode.camera)
        world.reset(episode.initial_state)
        for step, action in enumerate(episode.actions):
            if step in episode.qpos:
                image = simulation.render(camera_name=_CAMERA, width=size, height=size)
                yield image[::-1], world.data.qpos.copy()
            world.step(action)

    def close(self) -> None:
        """Free the OpenGL context."""
        self._world.environment.close()

    def _place_camera(self, world: StockWorld, pose: CameraPose) -> None:
        camera = world.model.camera(_CAMERA)
        rotation = CameraPose(pose.position, pose.rotation @ OPTICAL_TO_GL)
        camera.pos[:], camera.quat[:], camera.fovy[:] = rotation.position, rotation.quaternion, self._camera.fovy
