"""Where the runs differ from the paper's, as the report says it."""

from typing import Any

from stages.analyze.deviations import deviations

OLD: dict[str, Any] = {
    **{"task": "reach", "robot": "Panda", "cube_half_range": 0.15, "misalignment_deg": 0.0, "training_episodes": 300},
    **{"gamma": 0.9, "exploration_noise": 0.2, "preactivation_penalty": 0.0},
}
"""A run's row as it was answered before what the networks see was asked for."""


def _seen(proprioception: str, correlation: float = 0.0, **sizes: float) -> dict[str, Any]:
    scale = ", ".join(f'"{name}": {size}' for name, size in ({"cube": 1.0} | sizes).items())
    columns = {"proprioception": proprioception, "observation_scale": f"{{{scale}}}"}
    return OLD | columns | {"exploration_correlation": correlation}


def test_of_answers_older_than_the_question_nothing_is_said() -> None:
    assert len(deviations([OLD], [])) == 2


def test_the_papers_own_observation_is_no_deviation() -> None:
    assert deviations([_seen("joints")], []) == deviations([OLD], [])


def test_what_the_networks_see_by_task() -> None:
    lift = _seen("gripper_goal", 0.85, cube_to_eef=0.05, gripper_opening=0.03) | {"task": "lift"}
    said = deviations([_seen("forward_kinematics"), lift], [])
    assert said[2:] == [
        "Exploration noise correlates with that of the step before by reach 0, lift 0.85, as DDPG's; TD3's does not.",
        "Beside angles and velocities of the joints and the gripper's opening, the paper's, policies are told: "
        "reach the gripper's position, lift the gripper's position and how far it is to open or close.",
        "The networks see parts of the observation divided by typical sizes, the paper names none: lift cube_to_eef by "
        "0.05 and gripper_opening by 0.03.",
    ]


def test_sizes_of_what_is_not_observed_are_not_said() -> None:
    [said] = deviations([_seen("joints", cube=0.15, eef=0.2, cube_to_eef=0.05)], [])[2:]
    assert said.endswith("the paper names none: cube by 0.15.")
