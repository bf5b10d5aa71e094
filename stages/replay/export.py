"""Files of a replayed episode for other programs: MCAP for Foxglove and Rerun, MP4 for everyone."""

from pathlib import Path

from schemas.errors import ConfigError, MachineError, unknown_choice
from stages.replay.frames import AS_THE_RUN, View, run_camera
from stages.replay.logs import load_episode
from stages.replay.mcap_export import write_mcap
from stages.replay.proof import ReplayResult
from stages.replay.recording import write_track
from stages.replay.rollout import roll_out
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


def export_episode(run_dir: Path, split: str, episode: int, save: Path, *, view: View = AS_THE_RUN) -> ReplayResult:
    """Replay a run's episode and write it to `save` in the format of its ending.

    `view` is the camera of its frames; the estimates in it are those that were logged.

    Raises:
        ConfigError: see `check_target`.
        ArtifactError: the episode, its run or its estimator is missing or damaged.
        MachineError: there is no OpenGL to render with, or no space.
    """
    check_target(save)
    logged = load_episode(run_dir, split, episode)
    rollout = roll_out(logged, run_camera(logged, view))
    try:
        if save.suffix == ".rrd":
            write_track(run_track(logged, rollout), save)
        elif save.suffix == ".mcap":
            write_mcap(logged, rollout, save)
        else:
            write_mp4(rollout.frames, save)
    except OSError as error:
        raise MachineError(f"cannot write {save}: {error.strerror or error}") from error
    return rollout.result
