"""Frames that policies saw, recorded to MCAP while they train: every n-th episode.

Topics are a dataset's and the estimate; the arm's links and the simulator's states are not among them, for a replay has
those.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from schemas import mcap_files, mcap_topics
from schemas.entities import CUBE_EST
from schemas.files import recording_path
from schemas.images import ImageFormat, encode
from schemas.mcap_frames import CameraView, frame_messages
from stages.policy.config import RunSpec
from stages.sim.pool import View

_COMPRESSION = "zstd"
_FORMAT: ImageFormat = "png"


class Recorder:
    """Collects an episode of every run as it is stepped, and writes a file for each.

    `intrinsics` is K (3, 3) of the runs' camera.
    """

    def __init__(
        self, specs: Sequence[RunSpec], view: View, intrinsics: np.ndarray, joint_names: tuple[str, ...]
    ) -> None:
        self._specs, self._joint_names = list(specs), joint_names
        self._views = [
            CameraView((pose.position, pose.quaternion), view.image_size, intrinsics, _FORMAT) for pose in view.poses
        ]
        self.begin()

    def begin(self) -> None:
        """A new episode; nothing is known of it yet."""
        self._states: list[np.ndarray] = []
        self._frames: list[np.ndarray] = []
        self._estimates: list[np.ndarray] = []
        self._actions: list[np.ndarray] = []

    def see(self, states: np.ndarray, frames: np.ndarray, estimates: np.ndarray) -> None:
        """A state of every run: records (n,), what its camera saw (n, H, W, 3) and what was made of it (n, 3) [m]."""
        self._states.append(states.copy())
        self._frames.append(frames.copy())
        self._estimates.append(estimates.copy())

    def act(self, actions: np.ndarray) -> None:
        """The actions (n, a) applied from the states seen last."""
        self._actions.append(actions.copy())

    def write(self, rows: Sequence[int], split: str, episode: int) -> None:
        """A file for each of these runs, whole or absent."""
        for row in rows:
            path = recording_path(self._specs[row].out, split, episode)
            path.parent.mkdir(exist_ok=True)
            self._write(row, path, {"split": split, "episode": str(episode)})

    def _write(self, row: int, path: Path, which: dict[str, str]) -> None:
        spec = self._specs[row]
        identity = {name: str(getattr(spec, name)) for name in ("task", "scheme", "misalignment_deg", "seed")}
        with mcap_files.create(path, _COMPRESSION) as writer:
            metadata = {"run": spec.run_id, **which, **identity, "misalignment_kind": spec.misalignment_kind}
            writer.add_metadata(mcap_topics.EPISODE_METADATA, metadata)
            for step, states in enumerate(self._states):
                state = states[row]
                cube = state["cube_position"], state["cube_quaternion"]
                data = encode(self._frames[step][row], _FORMAT, chunked=True)
                links = {mcap_topics.CUBE_FRAME: cube}
                messages = frame_messages(self._views[row], data, state, self._joint_names, links)
                messages[CUBE_EST] = mcap_topics.cube_pose(
                    int(state["time_ns"]), self._estimates[step][row], state["cube_quaternion"]
                )
                if step < len(self._actions):
                    action = self._actions[step][row]
                    messages[mcap_topics.ACTION] = mcap_topics.action(int(state["time_ns"]), step, action)
                for topic, message in messages.items():
                    mcap_files.write(writer, topic, int(state["time_ns"]), message)
