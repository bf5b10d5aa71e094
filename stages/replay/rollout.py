"""A logged episode played again before a camera."""

from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from stages.replay.frames import Camera, run_camera
from stages.replay.logs import LoggedEpisode
from stages.replay.proof import ReplayResult, compare
from stages.replay.simulate import Trajectory, scene_of, simulate
from stages.replay.track import Pose
from stages.sim.renderer import Renderer
from stages.sim.scene import Scene
from stages.sim.world import World


@dataclass(frozen=True)
class Rollout:
    """n steps; frames and link poses are n + 1, the initial state first."""

    scene: Scene
    camera: Camera
    trajectory: Trajectory
    result: ReplayResult
    qpos: np.ndarray  # (n + 1, nq) of the whole scene
    integration_states: np.ndarray  # (n + 1, k), MuJoCo's
    links: dict[str, Pose]  # of every body
    frames: list[np.ndarray]  # each (H, W, 3) uint8; none where they were not rendered
    seen: list[np.ndarray]  # the same in the size that an estimator takes


def roll_out(
    logged: LoggedEpisode, camera: Camera | None = None, estimator_size: int | None = None, rendered: bool = True
) -> Rollout:
    """Replay an episode with frames from `camera`, by default the run's own; none of them unless `rendered`.

    With an `estimator_size` [pixels] of its own an estimator looks through the same camera.

    Raises:
        ArtifactError: the run's estimator is gone, or the initial state is of another scene.
        MachineError: there is no OpenGL to render with.
    """
    scene, camera = scene_of(logged), camera or run_camera(logged)
    qpos: list[np.ndarray] = []
    integration_states: list[np.ndarray] = []
    poses: list[dict[str, tuple[np.ndarray, np.ndarray]]] = []
    shown = camera.config.image_size
    seen = estimator_size or shown
    frames: dict[int, list[np.ndarray]] = {size: [] for size in {shown, seen} if rendered}
    with ExitStack() as stack:
        renderers = {size: stack.enter_context(Renderer(scene, size, camera.config.fovy)) for size in frames}

        def watch(world: World) -> None:
            qpos.append(world.qpos_full())
            integration_states.append(world.integration_state())
            poses.append(world.link_poses())
            for size, renderer in renderers.items():
                frames[size].append(renderer.render(qpos[-1], camera.pose))

        trajectory = simulate(logged, watch, compiled=False)
    result = compare(logged, trajectory)
    states, pictures = np.array(integration_states), (frames.get(shown, []), frames.get(seen, []))
    return Rollout(scene, camera, trajectory, result, np.array(qpos), states, _by_link(poses), *pictures)


def _by_link(poses: list[dict[str, tuple[np.ndarray, np.ndarray]]]) -> dict[str, Pose]:
    return {
        link: Pose(np.array([at[link][0] for at in poses]), np.array([at[link][1] for at in poses]))
        for link in poses[0]
    }
