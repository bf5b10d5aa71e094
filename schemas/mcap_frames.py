"""What an episode file says of one state that has a frame: the same topics whoever writes it."""

from dataclasses import dataclass

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

from schemas import mcap_topics
from schemas.mcap_topics import Message, Placement


@dataclass(frozen=True)
class CameraView:
    """A camera that stands still, and how its frames are stored."""

    placement: Placement
    size: int  # [pixels]
    intrinsics: np.ndarray  # K (3, 3)
    image_format: str  # png | jpeg


def frame_messages(
    view: CameraView,
    data: bytes,
    state: np.void,
    joint_names: tuple[str, ...],
    links: dict[str, Placement],
    transforms: FrameTransforms | None = None,
) -> dict[str, Message]:
    """Messages by topic of a state (a record of the sim room's STATE_DTYPE) and its encoded frame `data`.

    `links` are frames of the world besides the camera's; `transforms`, an earlier message of the same frames, is
    filled in anew.
    """
    time_ns, image_format = int(state["time_ns"]), view.image_format
    frames = {mcap_topics.CAMERA_FRAME: view.placement} | links
    return {
        mcap_topics.TF: mcap_topics.transforms(time_ns, frames, transforms),
        mcap_topics.CAMERA_CALIBRATION: mcap_topics.calibration(time_ns, view.size, view.intrinsics),
        mcap_topics.CAMERA_IMAGE: mcap_topics.image(time_ns, data, image_format),
        mcap_topics.CUBE_POSE: mcap_topics.cube_pose(time_ns, state["cube_position"], state["cube_quaternion"]),
        mcap_topics.ROBOT_JOINTS: mcap_topics.joint_states(time_ns, joint_names, state["qpos"], state["qvel"]),
    }
