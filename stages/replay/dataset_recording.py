"""Rerun recordings (.rrd) of an episode of a dataset."""

from pathlib import Path

from stages.replay.dataset_track import dataset_track
from stages.replay.recording import write_track


def record_dataset_episode(dataset: Path, episode: int, save: Path) -> int:
    """Write a recording of a dataset's episode to `save`: its frames as collected. Returns their number.

    Raises:
        ArtifactError: the episode or its dataset is missing or damaged.
        MachineError: there is no space.
    """
    track = dataset_track(dataset, episode)
    write_track(track, save)
    return len(track.clock)
