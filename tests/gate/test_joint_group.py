"""Servos of one robot part move together, also with those of another part if a coupling links both; fingers
move separately."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import LIMITS, make_robot
from tci.errors import CommandError
from tci.gate.joint_group import groups_of, make_chain
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map


def in_parts(*parts: str, linked: tuple[int, int] | None = None) -> Robot:
    """Returns a robot with a servo in each of these parts, and a coupling between two servos."""
    robot = make_robot(count=max(6, len(parts)))
    servos = [one.model_copy(update={"robot_part": parts[one.index]}) for one in robot.servos[: len(parts)]]
    couplings = () if linked is None else (robot.couplings[0].model_copy(update={"servos": linked}),)
    return robot.model_copy(update={"servos": tuple(servos), "couplings": couplings, "parts": ()})


def test_each_part_is_a_group_and_a_coupling_makes_one_of_two() -> None:
    parts = ("arm", "arm", "leg", "head", "leg", "head")
    free = groups_of(in_parts(*parts))
    assert [free.index(group) for group in free] == [0, 0, 2, 3, 2, 3]
    linked = groups_of(in_parts(*parts, linked=(2, 5)))
    assert [linked.index(group) for group in linked] == [0, 0, 2, 2, 2, 2]


def test_fingers_on_the_board_of_an_arm_are_another_group() -> None:
    robot = load_robot("icub")
    groups = groups_of(robot)
    fingers = {
        servo
        for part in robot.parts
        if part.kind == "fingers"
        for servo in joint_map(robot, part.name).servos.tolist()
    }
    assert fingers
    arms = {one.index for one in robot.servos if "arm" in one.robot_part} - fingers
    assert not {groups[servo] for servo in fingers} & {groups[servo] for servo in arms}


def test_servos_without_limits_form_no_group() -> None:
    robot = make_robot(coupled=False, limits=LIMITS.model_copy(update={"jerk": None}))
    with pytest.raises(CommandError, match=r"^a servo without limits can't be moved$") as raised:
        make_chain(
            robot, [0, 1], np.zeros(6), old=None, fresh=(), period=0.01, speed_share=1.0,
            guard=lambda stop: None,
        )  # fmt: skip
    assert raised.value.code is Code.LIMITS_UNKNOWN
