"""Torques of joints as drivers carry them: a joint that reports none is NaN, and the others still count."""

from __future__ import annotations

import numpy as np

import tci
from tci.commissioning.doctor import judge_torques
from tci.drivers.diagnosis import Level
from tci.drivers.ros.arrivals import JointArrivals
from tci.frames import read_only
from tci.messages import JointReading, Reading

ROBOT = tci.load_robot("g1-bare")
COUNT = len(ROBOT.servos)
NAMES = [servo.name for servo in ROBOT.servos]


def joint_state(names: list[str], effort: list[float], second: int) -> dict[str, object]:
    zeros = [0.0] * len(names)
    return {
        "sec": second, "nanosec": 0, "name": names, "position": zeros, "velocity": zeros, "effort": effort,
    }  # fmt: skip


def test_ros_keeps_the_efforts_of_joints_that_have_one() -> None:
    arrivals = JointArrivals(ROBOT, {name: index for index, name in enumerate(NAMES)})
    arrivals.receive(joint_state(NAMES[:20], [2.0] * 20, 1), 1.0)
    arrivals.receive(joint_state(NAMES[20:], [], 1), 1.0)
    assert arrivals.latest is not None
    torque = arrivals.latest.torque
    assert torque is not None
    assert torque[:20].tolist() == [2.0] * 20
    assert np.isnan(torque[20:]).all()


def reading(torque: np.ndarray | None) -> Reading:
    zeros = read_only(np.zeros(COUNT))
    return Reading(JointReading(1.0, 1, zeros, zeros, None if torque is None else read_only(torque)), ())


def test_the_doctor_names_joints_without_torques_that_touch_needs() -> None:
    some = np.zeros(COUNT)
    elbow = NAMES.index("left_elbow_joint")
    some[elbow] = np.nan
    some[NAMES.index("left_knee_joint")] = np.nan  # legs feel nothing
    assert list(judge_torques(ROBOT, reading(np.zeros(COUNT)))) == []
    (partly,) = judge_torques(ROBOT, reading(some))
    assert partly.level is Level.WARNING
    assert "left_elbow_joint" in partly.what
    assert "knee" not in partly.what
    (none,) = judge_torques(ROBOT, reading(None))
    assert none.level is Level.FAULT
    assert list(judge_torques(tci.load_robot("g1"), reading(None))) == []
