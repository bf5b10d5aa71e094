"""Topics of an episode's MCAP file (SPEC §4), their messages, and the frames of reference they are in.

Clock: log time, publish time and the timestamp inside a message are all the simulation's time in integer nanoseconds.

Frames: `world` has z up and its origin on the floor below the centre of the table. `camera` is the optical frame (x
right, y down, z forward). `/tf` gives every frame directly in the world, T_world_child: a point p_child of the child
frame is p_world = rotation · p_child + translation. Image coordinates have their origin on the outer corner of the
top-left pixel, hence the principal point of a centred camera is size / 2.
"""

from collections.abc import Iterable, Mapping

import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from schemas.messages_pb2 import Action, SimState

CAMERA_IMAGE = "/camera/image"  # foxglove.CompressedImage
CAMERA_CALIBRATION = "/camera/calibration"  # foxglove.CameraCalibration
TF = "/tf"  # foxglove.FrameTransforms
CUBE_POSE = "/cube/pose"  # foxglove.PoseInFrame, the ground truth
ROBOT_JOINTS = "/robot/joints"  # foxglove.JointStates
ACTION = "/action"  # dense2sparse.Action
SIM_STATE = "/sim/state"  # dense2sparse.SimState

WORLD_FRAME = "world"
CAMERA_FRAME = "camera"
CUBE_FRAME = "cube"

EPISODE_METADATA = "episode"  # name of the metadata record

_NANOSECONDS = 1_000_000_000  # of a second
_NO_ROTATION = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]  # R (3, 3) of a camera that is not rectified

Message = CompressedImage | CameraCalibration | FrameTransforms | PoseInFrame | JointStates | Action | SimState
Placement = tuple[np.ndarray, np.ndarray]
"""Position (3,) [m] and orientation (w, x, y, z) of a frame in the world."""


def image(time_ns: int, data: bytes, image_format: str) -> CompressedImage:
    """An encoded frame; `image_format` is png or jpeg."""
    return CompressedImage(timestamp=_timestamp(time_ns), frame_id=CAMERA_FRAME, data=data, format=image_format)


def calibration(time_ns: int, size: int, intrinsics: np.ndarray) -> CameraCalibration:
    """A square pinhole image of `size` pixels without distortion; `intrinsics` is K (3, 3)."""
    rows = intrinsics.tolist()
    return CameraCalibration(
        timestamp=_timestamp(time_ns),
        frame_id=CAMERA_FRAME,
        width=size,
        height=size,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[value for row in rows for value in row],
        R=_NO_ROTATION,
        P=[value for row in rows for value in (*row, 0.0)],  # (3, 4), its last column zero
    )


def transforms(
    time_ns: int, frames: Mapping[str, Placement], message: FrameTransforms | None = None
) -> FrameTransforms:
    """T_world_child of every child frame.

    `message`, an earlier one of the same frames, is filled in anew and returned: half the work of making one.
    """
    if message is None:
        message = FrameTransforms()
        for child in frames:
            message.transforms.add(parent_frame_id=WORLD_FRAME, child_frame_id=child)
    seconds, nanos = divmod(int(time_ns), _NANOSECONDS)
    for transform, (position, quaternion) in zip(message.transforms, frames.values(), strict=True):
        stamp, translation, rotation = transform.timestamp, transform.translation, transform.rotation
        stamp.seconds, stamp.nanos = seconds, nanos
        translation.x, translation.y, translation.z = position.tolist()
        rotation.w, rotation.x, rotation.y, rotation.z = quaternion.tolist()
    return message


def cube_pose(time_ns: int, position: np.ndarray, quaternion: np.ndarray) -> PoseInFrame:
    """Pose of the cube's centre in the world: position (3,) [m], quaternion (w, x, y, z)."""
    pose = Pose(position=_vector(position), orientation=_quaternion(quaternion))
    return PoseInFrame(timestamp=_timestamp(time_ns), frame_id=WORLD_FRAME, pose=pose)


def joint_states(time_ns: int, names: Iterable[str], qpos: np.ndarray, qvel: np.ndarray) -> JointStates:
    """Joints of the arm: positions (n,) [rad], velocities (n,) [rad/s]."""
    rows = zip(names, qpos.tolist(), qvel.tolist(), strict=True)
    joints = [JointState(name=name, position=position, velocity=velocity) for name, position, velocity in rows]
    return JointStates(timestamp=_timestamp(time_ns), joints=joints)


def action(time_ns: int, step: int, values: np.ndarray) -> Action:
    """The action (7,) or (8,) applied from the state at `time_ns`."""
    return Action(timestamp=_timestamp(time_ns), step=step, values=values.tolist())


def sim_state(time_ns: int, step: int, integration_state: np.ndarray, qpos: np.ndarray) -> SimState:
    """The simulator's state (k,) and generalised positions (nq,)."""
    state, positions = integration_state.tolist(), qpos.tolist()
    return SimState(timestamp=_timestamp(time_ns), step=step, integration_state=state, qpos=positions)


def placement(message: FrameTransforms, child: str) -> Placement:
    """Position and quaternion (w, x, y, z) of frame `child` in the world; KeyError when the message has none."""
    for transform in message.transforms:
        if transform.child_frame_id == child:
            t, q = transform.translation, transform.rotation
            return np.array([t.x, t.y, t.z]), np.array([q.w, q.x, q.y, q.z])
    raise KeyError(f"no transform of {child!r}")


def _timestamp(time_ns: int) -> Timestamp:
    seconds, nanos = divmod(int(time_ns), _NANOSECONDS)
    return Timestamp(seconds=seconds, nanos=nanos)


def _vector(xyz: np.ndarray) -> Vector3:
    x, y, z = xyz.tolist()
    return Vector3(x=x, y=y, z=z)


def _quaternion(wxyz: np.ndarray) -> Quaternion:
    w, x, y, z = wxyz.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
