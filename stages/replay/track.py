"""What a recording shows of one episode, wherever it comes from: a replayed run or a dataset's MCAP file."""

from dataclasses import dataclass, field

import numpy as np

from stages.sim.camera import CameraPose, Intrinsics
from stages.sim.renderer import LinkMesh


@dataclass(frozen=True)
class Clock:
    """When the rows of a series are."""

    time_ns: np.ndarray  # (n,) simulation time
    step: np.ndarray  # (n,)

    def __len__(self) -> int:
        return len(self.step)

    def at(self, rows: np.ndarray) -> "Clock":
        """The times of some rows."""
        return Clock(self.time_ns[rows], self.step[rows])


@dataclass(frozen=True)
class Pose:
    """A frame in the world over n rows: T_world_frame."""

    position: np.ndarray  # (n, 3) [m]
    quaternion: np.ndarray  # (n, 4), (w, x, y, z)

    def after_steps(self) -> "Pose":
        """Without the first row, the initial state's."""
        return Pose(self.position[1:], self.quaternion[1:])


@dataclass(frozen=True)
class Actions:
    """What was applied, which may be known at more times than the state."""

    clock: Clock
    values: np.ndarray  # (k, 7) or (k, 8), normalised


@dataclass(frozen=True)
class EpisodeTrack:
    """n states of an episode, each with its frame. What a source does not have is None or empty, and is not shown."""

    name: str
    description: str  # Markdown
    clock: Clock  # (n,)
    cube: Pose
    links: dict[str, Pose]  # of the links that have a mesh
    meshes: list[LinkMesh]
    camera: CameraPose
    intrinsics: Intrinsics
    images: list[bytes]  # n, encoded
    media_type: str
    joints: np.ndarray  # (n, 7) [rad]
    actions: Actions
    estimate: np.ndarray | None = None  # (n, 3) [m], estimated cube position
    gripper_point: np.ndarray | None = None  # (n, 3) [m]
    best_reward: float = 1.0  # of one step
    scalars: dict[str, np.ndarray] = field(default_factory=dict)  # entity path → (n,)
    states: dict[str, np.ndarray] = field(default_factory=dict)  # entity path → (n,) strings
