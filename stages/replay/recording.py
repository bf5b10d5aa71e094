"""Rerun recordings (.rrd) of an episode: of a run, replayed and rendered anew, or of a dataset."""

from pathlib import Path

from rerun_blueprints.episode import episode_blueprint
from stages.replay.dataset_track import dataset_track
from stages.replay.frames import AS_THE_RUN, View, recorded_view, run_camera
from stages.replay.logs import load_episode
from stages.replay.proof import ReplayResult
from stages.replay.recording_file import recording_file
from stages.replay.rollout import roll_out
from stages.replay.run_track import run_track
from stages.replay.scene_log import log_scene
from stages.replay.series_log import log_series
from stages.replay.track import EpisodeTrack


def record_episode(run_dir: Path, split: str, episode: int, save: Path, *, view: View = AS_THE_RUN) -> ReplayResult:
    """Write a recording of a run's episode to `save`.

    Frames are those that were recorded with the run, or rendered anew, by default by the run's camera.

    Raises:
        ArtifactError: the episode, its run or its estimator is missing or damaged.
        MachineError: there is no OpenGL to render with, or no space.
    """
    logged = load_episode(run_dir, split, episode)
    recorded = recorded_view(logged) if view == AS_THE_RUN else None
    camera = recorded.camera if recorded else run_camera(logged, view)
    rollout = roll_out(logged, camera, rendered=recorded is None)
    write_track(run_track(logged, rollout, recorded.frames if recorded else None), save)
    return rollout.result


def record_dataset_episode(dataset: Path, episode: int, save: Path) -> int:
    """Write a recording of a dataset's episode to `save`: its frames as collected. Returns their number.

    Raises:
        ArtifactError: the episode or its dataset is missing or damaged.
        MachineError: there is no space.
    """
    track = dataset_track(dataset, episode)
    write_track(track, save)
    return len(track.clock)


def write_track(track: EpisodeTrack, save: Path) -> None:
    """Write the recording of an episode to `save`, whole or not at all."""
    blueprint = episode_blueprint(
        estimated=track.estimate is not None, rewarded=bool(track.scalars), best_reward=track.best_reward
    )
    with recording_file(track.name, save, blueprint) as recording:
        log_scene(recording, track)
        log_series(recording, track)
