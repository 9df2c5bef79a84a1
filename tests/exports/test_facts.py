"""The run-time query returns every fact with its correct value, also after a conversion to JSON and back."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.exports.facts import RobotFacts, _reach, generic_limits, query, read_facts
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain

ROBOTS = ("nao", "icub")


@pytest.mark.parametrize("name", ROBOTS)
def test_it_returns_from_json_as_it_was(name: str) -> None:
    facts = query(load_robot(name))
    assert read_facts(facts.model_dump_json()) == facts
    assert facts.format == "tci.robot/1"
    assert RobotFacts.model_json_schema()["properties"].keys() == RobotFacts.model_fields.keys()


@pytest.mark.parametrize("name", ROBOTS)
def test_its_tables_give_the_poses_of_the_kinematics(name: str) -> None:
    robot = load_robot(name)
    facts, kinematics = query(robot), KinematicChain(robot)
    assert {(t.part, t.convention) for t in facts.denavit_hartenberg} >= {
        (part, convention)
        for part in ("left_arm", "right_arm", "head")
        for convention in ("classic", "modified")
    }
    position = initial_position(robot) + 0.1
    for table in facts.denavit_hartenberg:
        pose = np.array(table.base)
        for row in table.rows:
            turn = rot_z(row.theta + position[row.servo], row.d)
            link = rot_x(row.alpha, row.a)
            pose = pose @ (turn @ link if table.convention == "classic" else link @ turn)
        expected = kinematics.poses(position, [table.link])[table.link]
        np.testing.assert_allclose(pose @ np.array(table.tool), expected, atol=1e-9)


def rot_z(angle: float, along: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, along], [0, 0, 0, 1]])


def rot_x(angle: float, along: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, along], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize("name", ROBOTS)
def test_generic_limits_are_those_of_the_servos(name: str) -> None:
    robot = load_robot(name)
    for part in robot.parts:
        joints = joint_map(robot, part.name)
        for fact, joint in zip(generic_limits(robot, part.name), part.servos, strict=True):
            if joint.servo is None:
                assert fact.lower is fact.upper is None
                continue
            ends = []
            moved = [robot.servos[servo] for servo in (joint.servo, *(term.servo for term in joint.terms))]
            limits = moved[0].limits
            for side in ("lower", "upper"):
                position = initial_position(robot).copy()
                for servo in moved if joint.transform == "synergy" else moved[:1]:
                    limit = getattr(servo.limits, side)
                    position[servo.index] = np.nan if limit is None else limit
                ends.append(joints.to_generic(position)[joint.id])
            if limits.lower is None:
                assert fact.lower is None
            else:
                assert (fact.lower, fact.upper) == pytest.approx(tuple(sorted(ends)))


def test_a_robot_without_a_model_tells_what_it_has() -> None:
    robot = load_robot("nao").model_copy(update={"model": None, "patches": ()})
    facts = query(robot)
    assert facts.servos == robot.servos
    assert facts.links == facts.denavit_hartenberg == facts.patches == facts.fields == ()


def test_damaged_facts_get_one_error_that_names_every_fault() -> None:
    facts = json.loads(query(load_robot("nao")).model_dump_json())
    damaged = {**facts, "format": "tci.robot/2", "surprise": 1, "name": 7}
    with pytest.raises(DescriptionError, match="the topic: 3 faults") as caught:
        read_facts(json.dumps(damaged), source="the topic")
    text = str(caught.value)
    for word in ("format: ", "'tci.robot/1'", "surprise: ", "name: "):
        assert word in text
    with pytest.raises(DescriptionError, match="1 fault"):
        read_facts("{")


def test_skin_that_no_cone_fits_is_told_without_one() -> None:
    robot = load_robot("nao")
    parts = tuple(
        part.model_copy(update={"side": None}) if part.name == "left_arm" else part for part in robot.parts
    )
    facts = query(robot.model_copy(update={"parts": parts}))
    assert {patch.name for patch in facts.patches if patch.cone is None} == {
        "left_forearm", "left_upper_arm", "head", "left_hand", "right_hand",
    }  # fmt: skip


@pytest.mark.parametrize("end", ["lower", "upper"])
def test_a_joint_of_several_servos_with_an_unknown_limit_has_no_known_reach(end: str) -> None:
    robot = load_robot("icub")
    joint = next(one for one in robot.part("left_fingers").servos if len(one.terms) > 1)
    servos = list(robot.servos)
    first = servos[joint.terms[0].servo]
    unknown = first.limits.model_copy(update={end: None})
    servos[first.index] = first.model_copy(update={"limits": unknown})
    assert np.isnan(_reach(robot.model_copy(update={"servos": tuple(servos)}), joint)).all()
