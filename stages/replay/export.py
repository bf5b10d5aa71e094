"""Files of a replayed episode for other programs: MCAP for Foxglove and Rerun, MP4 for everyone."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from schemas.errors import ConfigError, MachineError, unknown_choice
from stages.replay.frames import AS_THE_RUN, View, run_camera
from stages.replay.logs import LoggedEpisode, load_episode
from stages.replay.mcap_export import write_mcap
from stages.replay.proof import ReplayResult
from stages.replay.recording import write_track
from stages.replay.reestimate import Eye, WhatIf, reestimate, what_if
from stages.replay.rollout import Rollout, roll_out
from stages.replay.run_track import run_track
from stages.replay.video import write_mp4

FORMATS = (".rrd", ".mcap", ".mp4")


def check_target(save: Path) -> None:
    """Pass if an episode can be written as `save`: asked before the work of replaying it.

    Raises:
        ConfigError: its ending is none of `FORMATS`, or its directory does not exist.
    """
    if save.suffix not in FORMATS:
        raise ConfigError(f"--save {save}: {unknown_choice('format', save.suffix, FORMATS)}")
    if not save.parent.is_dir():
        raise ConfigError(f"--save {save}: there is no directory {save.parent}")


class Exported(NamedTuple):
    """Whether the replay is the logged episode, and what an estimator made of it."""

    result: ReplayResult
    what_if: WhatIf | None


def export_episode(
    run_dir: Path,
    split: str,
    episode: int | None,
    save: Path | None,
    *,
    view: View = AS_THE_RUN,
    eye: Eye | None = None,
) -> Exported:
    """Replay a run's episode before a camera and write it to `save`, if anywhere, in the format of its ending.

    `view` is the camera of its frames. The estimates in it are those that were logged; with an `eye` they are made
    again from what that camera sees, and the rewards that follow from them.

    Raises:
        ConfigError: see `check_target`, or the view is of no camera that could be.
        ArtifactError: the episode, its run or its estimator is missing or damaged, or the replay is another trajectory.
        MachineError: there is no OpenGL to render with, or no space.
    """
    if save:
        check_target(save)
    logged = load_episode(run_dir, split, episode)
    camera = run_camera(logged, view, eye.camera if eye else {})
    rollout = roll_out(logged, camera, eye.image_size if eye else None)
    rollout.result.require_identical()
    outcome = None
    if eye:
        estimate = eye.predict(np.stack(rollout.seen[1:]))
        again = reestimate(logged, estimate, f"{eye.name} from {rollout.camera.misalignment}")
        outcome, logged = what_if(logged, again), again
    if save:
        _write(logged, rollout, save)
    return Exported(rollout.result, outcome)


def _write(logged: LoggedEpisode, rollout: Rollout, save: Path) -> None:
    try:
        if save.suffix == ".rrd":
            write_track(run_track(logged, rollout), save)
        elif save.suffix == ".mcap":
            write_mcap(logged, rollout, save)
        else:
            write_mp4(rollout.frames, save)
    except OSError as error:
        raise MachineError(f"cannot write {save}: {error.strerror or error}") from error
