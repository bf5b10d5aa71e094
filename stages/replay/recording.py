"""Rerun recordings (.rrd) of an episode of a run, replayed and rendered anew."""

from pathlib import Path
from typing import TYPE_CHECKING

from rerun_blueprints.episode import episode_blueprint
from schemas.files import recording_path
from stages.replay.frames import AS_THE_RUN, View, run_camera
from stages.replay.logs import LoggedEpisode, load_episode
from stages.replay.proof import ReplayResult
from stages.replay.recording_file import recording_file
from stages.replay.rollout import roll_out
from stages.replay.run_track import run_track
from stages.replay.scene_log import log_scene
from stages.replay.series_log import log_series
from stages.replay.track import EpisodeTrack

if TYPE_CHECKING:
    from stages.replay.recorded import Recorded


def record_episode(
    run_dir: Path, split: str, episode: int, save: Path, *, view: View = AS_THE_RUN, proven: bool = False
) -> ReplayResult:
    """Write a recording of a run's episode to `save`.

    Frames are those that were recorded with the run, or rendered anew, by default by the run's camera. What moves
    is the replay: where that is not `identical` the picture and the logged numbers are of different trajectories, so
    a `proven` recording is not written then.

    Raises:
        ArtifactError: the episode, its run or its estimator is missing or damaged; it is to be proven and differs.
        MachineError: there is no OpenGL to render with, or no space.
    """
    logged = load_episode(run_dir, split, episode)
    recorded = _recorded(logged) if view == AS_THE_RUN else None
    camera = recorded.camera if recorded else run_camera(logged, view)
    rollout = roll_out(logged, camera, rendered=recorded is None)
    if proven:
        rollout.result.require_identical()
    write_track(run_track(logged, rollout, recorded.frames if recorded else None), save)
    return rollout.result


def _recorded(logged: LoggedEpisode) -> "Recorded | None":
    """What was recorded of the episode, if it was. Reading MCAP is imported for one that was."""
    path = recording_path(logged.run_dir, logged.split, logged.episode)
    if not path.is_file():
        return None
    from stages.replay.recorded import read_recording

    return read_recording(logged, path)


def write_track(track: EpisodeTrack, save: Path) -> None:
    """Write the recording of an episode to `save`, whole or not at all."""
    blueprint = episode_blueprint(
        estimated=track.estimate is not None, rewarded=bool(track.scalars), best_reward=track.best_reward
    )
    with recording_file(track.name, save, blueprint) as recording:
        log_scene(recording, track)
        log_series(recording, track)
