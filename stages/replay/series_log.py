"""Writes what changes over an episode into a Rerun recording: rewards, distances, errors, actions, states."""

import numpy as np
import rerun as rr

from schemas import entities
from stages.replay.scene_log import times
from stages.replay.track import Clock, EpisodeTrack

# entity path → (name in the legend with its unit, colour)
_LINES: dict[str, tuple[str, tuple[int, ...]]] = {
    entities.reward("dense_true"): ("dense, true cube", entities.TRUE_COLOUR),
    entities.reward("dense_est"): ("dense, estimated cube", entities.ESTIMATED_COLOUR),
    entities.reward("sparse"): ("sparse", entities.SPARSE_COLOUR),
    entities.reward("used"): ("given to TD3", entities.USED_COLOUR),
    entities.DISTANCE_TRUE: ("gripper to true cube [m]", entities.TRUE_COLOUR),
    entities.DISTANCE_EST: ("gripper to estimated cube [m]", entities.ESTIMATED_COLOUR),
    entities.ESTIMATION_ERROR: ("estimation error [m]", entities.ERROR_COLOUR),
}
_OFF, _ON = (58, 62, 72), entities.TRUE_COLOUR
_PHASE_COLOURS = {
    "warmup": entities.NEUTRAL_COLOUR,
    "dense": entities.ESTIMATED_COLOUR,
    "sparse": entities.SPARSE_COLOUR,
}


def log_series(recording: rr.RecordingStream, track: EpisodeTrack) -> None:
    """Everything that is a number or a state over time."""
    recording.log(entities.DESCRIPTION, rr.TextDocument(track.description, media_type="text/markdown"), static=True)
    for path, values in track.scalars.items():
        name, colour = _LINES[path]
        width = 1.2 if path == entities.reward("used") else 3.0  # thin on the broad line of the term it is
        recording.log(path, rr.SeriesLines(names=name, colors=colour, widths=width), static=True)
        recording.send_columns(path, times(track.clock), rr.Scalars.columns(scalars=values))
    _log_many(recording, entities.ACTION, track.actions.clock, track.actions.values)
    _log_many(recording, entities.JOINTS, track.clock, track.joints)
    for path, states in track.states.items():
        _log_states(recording, track, path, states)


def _log_many(recording: rr.RecordingStream, path: str, clock: Clock, values: np.ndarray) -> None:
    """A line for every joint, and one for the gripper where there is an eighth column; values (n, 7) or (n, 8)."""
    names = [f"joint {number}" for number in range(1, 8)] + ["gripper"] * (values.shape[1] - 7)
    colours = entities.JOINT_COLOURS[: len(names)]
    recording.log(path, rr.SeriesLines(names=names, colors=colours, widths=[1.8] * len(names)), static=True)
    columns = rr.Scalars.columns(scalars=values.ravel().astype(np.float64))
    recording.send_columns(path, times(clock), columns.partition([values.shape[1]] * len(values)))


def _log_states(recording: rr.RecordingStream, track: EpisodeTrack, path: str, states: np.ndarray) -> None:
    """Only where a state begins, which is what the timeline draws."""
    begins = np.flatnonzero(np.concatenate([[True], states[1:] != states[:-1]]))
    values = sorted(set(states.tolist()))
    colours = [_PHASE_COLOURS.get(value, _OFF if value == "no" else _ON) for value in values]
    recording.log(path, rr.StateConfiguration(values=values, labels=values, colors=colours), static=True)
    columns = rr.StateChange.columns(state=states[begins].tolist())
    recording.send_columns(path, times(track.clock.at(begins)), columns)
