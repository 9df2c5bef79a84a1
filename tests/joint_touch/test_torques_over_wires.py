"""Joint torques as drivers transport them. The torque of a joint that reports none is NaN, and the other
torques are used."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.drivers.diagnosis import Level
from tci.errors import FrameError
from tci.lab.commissioning.doctor import judge_torques
from tci.messages import JointReading, Reading
from tci.messages.frames import read_only
from tci.wires.ros.arrivals import ImuArrivals, JointArrivals

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


def imu(frame: str, acceleration: tuple[float, float, float], second: int) -> dict[str, object]:
    return {
        "sec": second, "nanosec": 0, "frame_id": frame, "linear_acceleration_covariance": [0.0] * 9,
        "linear_acceleration": dict(zip("xyz", acceleration, strict=True)),
    }  # fmt: skip


def test_an_imu_of_ros_in_any_link_tells_the_gravity_of_the_root() -> None:
    waist = NAMES.index("waist_yaw_joint")
    position = np.zeros(COUNT)
    position[waist] = np.pi / 2  # the torso is turned to the left
    joints = JointReading(5.0, 1, read_only(position), read_only(np.zeros(COUNT)), read_only(np.ones(COUNT)))
    imus = ImuArrivals(ROBOT)
    assert imus.complete(joints) is joints  # a robot without an IMU
    imus.receive(imu("torso_link", (1.0, 0.0, 9.5), 5), 5.0)
    complete = imus.complete(joints)
    assert complete.gravity is not None
    np.testing.assert_allclose(complete.gravity, (0.0, -1.0, -9.5), atol=1e-9)
    assert complete.torque is joints.torque
    imus.receive(imu("", (1.0, 0.0, 9.5), 6), 6.0)
    np.testing.assert_allclose(np.asarray(imus.complete(joints).gravity), (-1.0, 0.0, -9.5))
    late = JointReading(6.2, 2, joints.position, joints.velocity, joints.torque)
    # the gravity direction is too old, so the torques that hold the weight are unknown
    assert imus.complete(late).torque is None
    with pytest.raises(FrameError, match="the frame 'gyro'; valid: a link of the model, such as pelvis"):
        imus.receive(imu("gyro", (1.0, 0.0, 9.5), 7), 7.0)
    with pytest.raises(FrameError, match="no acceleration"):
        imus.receive({**imu("", (0.0, 0.0, 0.0), 7), "linear_acceleration_covariance": [-1.0] * 9}, 7.0)


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
