"""An episode of a run as a track: replayed from the logs, rendered from the run's camera."""

import numpy as np

from schemas import entities
from schemas.images import encode_within
from stages.policy import rewards
from stages.replay.logs import LoggedEpisode
from stages.replay.rollout import Rollout
from stages.replay.track import Actions, Clock, EpisodeTrack, Pose
from stages.sim.renderer import link_meshes

_IMAGE_BYTES = 7_000_000  # of all frames: a recording stays below 10 MB at any size of image

_SCALARS = {
    **{entities.reward(term): f"reward_{term}" for term in entities.REWARD_TERMS},
    entities.DISTANCE_TRUE: "distance_true",
    entities.DISTANCE_EST: "distance_est",
    entities.ESTIMATION_ERROR: "estimation_error",
}


def run_track(logged: LoggedEpisode, rollout: Rollout, recorded: list[bytes] | None = None) -> EpisodeTrack:
    """Row k is the logged row k: the state after action k. `recorded` PNG frames are shown instead of rendered ones."""
    states, estimate = rollout.trajectory.states, logged.vector("cube_est")
    clock = Clock(logged.rows["time_ns"], logged.rows["step"])
    meshes = link_meshes(rollout.scene)
    image_format = rollout.camera.image_format
    return EpisodeTrack(
        name=f"{logged.run} {logged.split} {logged.episode}",
        description=_description(logged, rollout),
        clock=clock,
        cube=Pose(states["cube_position"], states["cube_quaternion"]),
        links={link: rollout.links[link].after_steps() for link in dict.fromkeys(mesh.link for mesh in meshes)},
        meshes=meshes,
        camera=rollout.camera.pose,
        intrinsics=rollout.camera.intrinsics,
        images=recorded or encode_within(rollout.frames[1:], image_format, _IMAGE_BYTES),
        media_type="image/png" if recorded else f"image/{image_format}",
        joints=states["qpos"],
        actions=Actions(clock, logged.rows["action"]),
        estimate=None if np.isnan(estimate).all() else estimate,
        gripper_point=states["eef"],
        best_reward=rewards.LIFTED if logged.task == "lift" else 1.0,
        scalars=_scalars(logged),
        states=_states(logged),
    )


def _scalars(logged: LoggedEpisode) -> dict[str, np.ndarray]:
    """The logged columns that have values: a run without estimator has no estimated side."""
    found = {path: logged.rows[column].astype(np.float64) for path, column in _SCALARS.items()}
    return {path: values for path, values in found.items() if not np.isnan(values).all()}


def _states(logged: LoggedEpisode) -> dict[str, np.ndarray]:
    signals = {entities.state(name): np.where(logged.rows[name], "yes", "no") for name in entities.STATE_SIGNALS}
    return {entities.STATE_PHASE: logged.rows["phase"], **signals}


def _description(logged: LoggedEpisode, rollout: Rollout) -> str:
    run, summary = logged.manifest.config["run"], logged.summary
    steps = summary["steps_to_success"]
    rows = {
        "outcome": "no success" if steps is None else f"success after {steps} steps",
        "return, dense true": f"{summary['return_dense_true']:.1f}",
        "return given to TD3": f"{summary['return_used']:.1f}",
        "camera": f"{rollout.camera.config.image_size}², {rollout.camera.misalignment}",
        "estimator": logged.reestimated or logged.manifest.config.get("estimator") or "none (true state)",
        "replay": rollout.result.message(),
    }
    return "\n".join(
        [
            f"# {logged.run}",
            f"**{logged.split} episode {logged.episode}** of {run['task']} under *{run['scheme']}*, seed {run['seed']}",
            "\n| | |\n|---|---|",
            *(f"| {name} | {value} |" for name, value in rows.items()),
            "\nGreen is true, orange is estimated. The estimate is a position; it is drawn with the true orientation.",
        ]
    )
