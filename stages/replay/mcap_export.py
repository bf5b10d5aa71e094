"""A replayed episode as an MCAP file with the topics of a dataset's (SPEC §4), and the estimate."""

import json
from pathlib import Path

import numpy as np

from schemas import mcap_files, mcap_topics
from schemas.entities import CUBE_EST
from schemas.images import encode
from schemas.mcap_frames import CameraView, frame_messages
from stages.replay.logs import LoggedEpisode
from stages.replay.rollout import Rollout
from stages.sim.renderer import link_meshes

_COMPRESSION = "zstd"


def write_mcap(logged: LoggedEpisode, rollout: Rollout, save: Path) -> None:
    """Write all n + 1 states with their frames, and the n actions at the times of the states they were applied from."""
    states = np.concatenate([[rollout.trajectory.initial], rollout.trajectory.states])
    estimate, bodies = logged.vector("cube_est"), _bodies(rollout)
    with mcap_files.create(save, _COMPRESSION) as writer:
        writer.add_metadata(mcap_topics.EPISODE_METADATA, _metadata(logged, rollout))
        for index, state in enumerate(states):
            time_ns = int(state["time_ns"])
            for topic, message in _state_messages(rollout, bodies, index, state).items():
                mcap_files.write(writer, topic, time_ns, message)
            if index > 0 and np.isfinite(estimate[index - 1]).all():
                guess = mcap_topics.cube_pose(time_ns, estimate[index - 1], state["cube_quaternion"])
                mcap_files.write(writer, CUBE_EST, time_ns, guess)
            if index < logged.steps:
                action = mcap_topics.action(time_ns, index, logged.rows["action"][index])
                mcap_files.write(writer, mcap_topics.ACTION, time_ns, action)


def _state_messages(
    rollout: Rollout, bodies: dict[str, str], index: int, state: np.void
) -> dict[str, mcap_topics.Message]:
    camera, time_ns = rollout.camera, int(state["time_ns"])
    placement = camera.pose.position, camera.pose.quaternion
    view = CameraView(placement, camera.intrinsics.size, camera.intrinsics.matrix, camera.image_format)
    data = encode(rollout.frames[index], camera.image_format)
    links = {
        frame: (rollout.links[body].position[index], rollout.links[body].quaternion[index])
        for frame, body in bodies.items()
    }
    whole = mcap_topics.sim_state(time_ns, index, rollout.integration_states[index], rollout.qpos[index])
    return {
        **frame_messages(view, data, state, rollout.scene.joint_names, links),
        mcap_topics.SIM_STATE: whole,
    }


def _bodies(rollout: Rollout) -> dict[str, str]:
    """Frame → body, of the cube and of every link that has a mesh."""
    scene = rollout.scene
    cube = scene.model.body(scene.cube_body).name
    return {mcap_topics.CUBE_FRAME: cube} | {mesh.link: mesh.link for mesh in link_meshes(scene)}


def _metadata(logged: LoggedEpisode, rollout: Rollout) -> dict[str, str]:
    run = logged.manifest.config["run"]
    return {
        "run": logged.run,
        "split": logged.split,
        "episode": str(logged.episode),
        "steps": str(logged.steps),
        **{name: str(run[name]) for name in ("task", "scheme", "misalignment_kind", "misalignment_deg", "seed")},
        "camera": rollout.camera.misalignment,
        "estimated_by": logged.reestimated or logged.manifest.config.get("estimator") or "nobody",
        "success": json.dumps(bool(logged.summary["success"])),
        "identical": json.dumps(rollout.result.identical),
        "config_sha256": logged.manifest.config_sha256,
        "schema_version": str(logged.manifest.schema_version),
        "versions": json.dumps(logged.manifest.environment.packages),
    }
