"""Messages say what they are given, in Foxglove's conventions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas import mcap_topics


def test_time_is_split_into_seconds_and_nanoseconds() -> None:
    stamp = mcap_topics.image(2_050_000_000, b"", "png").timestamp
    assert (stamp.seconds, stamp.nanos) == (2, 50_000_000)


@given(st.integers(0, 2**53))
def test_time_survives(time_ns: int) -> None:
    stamp = mcap_topics.image(time_ns, b"", "png").timestamp
    assert stamp.seconds * 1_000_000_000 + stamp.nanos == time_ns


def test_calibration_is_row_major_and_undistorted() -> None:
    message = mcap_topics.calibration(0, 64, np.array([[70.0, 0, 32], [0, 71, 33], [0, 0, 1]]))
    assert (message.width, message.height, message.frame_id) == (64, 64, "camera")
    assert list(message.K) == [70, 0, 32, 0, 71, 33, 0, 0, 1]
    assert list(message.P) == [70, 0, 32, 0, 0, 71, 33, 0, 0, 0, 1, 0]
    assert list(message.R) == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    assert not any(message.D)


def test_transforms_go_from_world_to_child() -> None:
    frames = {"camera": (np.array([1.0, 2, 3]), np.array([0.5, 0.1, 0.2, 0.3]))}
    (transform,) = mcap_topics.transforms(0, frames).transforms
    assert (transform.parent_frame_id, transform.child_frame_id) == ("world", "camera")
    assert (transform.rotation.w, transform.rotation.x) == (0.5, 0.1)
    assert transform.translation.z == 3


def test_placement_is_the_inverse_of_transforms() -> None:
    frames = {name: (np.arange(3.0) + i, np.arange(4.0) - i) for i, name in enumerate(("cube", "camera"))}
    message = mcap_topics.transforms(0, frames)
    for name, (position, quaternion) in frames.items():
        found = mcap_topics.placement(message, name)
        assert found[0].tolist() == position.tolist()
        assert found[1].tolist() == quaternion.tolist()
    with pytest.raises(KeyError, match="hand"):
        mcap_topics.placement(message, "hand")


def test_joint_states_pair_names_with_values() -> None:
    message = mcap_topics.joint_states(0, ("a", "b"), np.array([1.0, 2]), np.array([3.0, 4]))
    assert [(joint.name, joint.position, joint.velocity) for joint in message.joints] == [("a", 1, 3), ("b", 2, 4)]
    with pytest.raises(ValueError, match=r"zip\(\) argument"):
        mcap_topics.joint_states(0, ("a", "b"), np.zeros(3), np.zeros(3))
