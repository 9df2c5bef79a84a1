"""Other programs give the place of a gripper's finger in metres, its speed in m/s and its force in N, as
`franka_gripper` does; TCI's servo turns a pinion of 40 mm."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tci
from helpers.golden_wires import NOW, Served, node
from tci.gate.safe_command import GateState, GateToken, SafeCommand
from tci.messages import Mode, PlatformCommand
from tci.messages.frames import read_only
from tci.robot.description import Address, Robot
from tci.wires.ros.names import Names
from tci.wires.ros.native import NativeRobot
from tci.wires.ros.server import RosServer

FINGER, PART = "panda_finger_joint1", "left_gripper"
ROBOT = tci.load_robot("franka-hand")
(SERVO,) = (servo.index for servo in ROBOT.servos_of(PART))


def joint_state(**finger: float) -> dict[str, Any]:
    """As `joint_state_publisher` sends it."""
    names = [servo.joint or servo.name for servo in ROBOT.servos]
    fields = {
        field: [finger[field] if name == FINGER else 0.5 for name in names]
        for field in ("position", "velocity", "effort")
    }
    return {"sec": 100, "nanosec": 0, "name": names, **fields}


def command(angle: float) -> SafeCommand:
    servos, values = np.array([SERVO]), read_only(np.array([angle]))
    return SafeCommand(
        seal=GateToken(ROBOT.name), stamp=NOW, state=GateState.RUN, servos=servos, modes=(Mode.POSITION,),
        position=values, velocity=read_only(np.zeros(1)), acceleration=read_only(np.zeros(1)),
        torque=read_only(np.zeros(1)), stiffness={}, damping={}, clamped=(), refusals=(), reason=None,
        orders=(PlatformCommand(Mode.POSITION, servos, values, np.ones(1)),),
    )  # fmt: skip


def with_values() -> Robot:
    """The robot where a `forward_command_controller` moves the gripper."""
    address = Address(of=PART, to=f"{PART}_controller/commands")
    binding = ROBOT.binding("ros2").model_copy(update={"addresses": (address,)})
    return ROBOT.model_copy(update={"bindings": (binding,)})


def test_a_robot_in_ros_tells_and_takes_metres() -> None:
    for robot in (ROBOT, with_values()):
        own, heard, written = node()
        names = Names(robot, "ros2", "")
        native = NativeRobot(robot, own, names, arm=True, period=0.01, now=lambda: NOW)
        heard["/joint_states"](joint_state(position=0.03, velocity=0.02, effort=10.0))
        joints = native.reading().joints
        assert joints.torque is not None
        told = [one[SERVO] for one in (joints.position, joints.velocity, joints.torque)]
        assert told == pytest.approx([0.75, 0.5, 0.4])
        assert joints.position[0] == 0.5, "an angle stays one"
        native.send(command(0.25))
        ((topic, _, values),) = written
        named = [FINGER], [0.01]
        assert topic.startswith(f"/{PART}_controller/")
        found = (values[3], values[4][0][0]) if len(values) > 2 else ([FINGER], values[1])
        assert found == (named[0], pytest.approx(named[1]))


def test_a_robot_that_tci_serves_tells_and_takes_metres() -> None:
    own, heard, shown = node()
    served = Served(ROBOT)
    with served.still():
        server = RosServer(served.driver, "", own, middleware="ros2", namespace="")
        served.show(server)
        states = [values for topic, _, values in shown if topic == "/joint_states"]
        angles = served.reading.joints
        assert angles.torque is not None
        place = states[0][3].index(FINGER)
        assert [column[place] for column in states[0][4:7]] == pytest.approx([
            0.04 * angles.position[SERVO], 0.04 * angles.velocity[SERVO], angles.torque[SERVO] / 0.04,
        ])  # fmt: skip
        point = {"positions": [0.02], "time_from_start": {"sec": 0, "nanosec": 0}}
        for topic, fields, angle in (
            ("joint_trajectory", {"joint_names": [FINGER], "points": [point]}, 0.5),
            ("commands", {"data": [0.01]}, 0.25),
        ):
            heard[f"/{PART}_controller/{topic}"](fields)
            (found,) = (one for one in orders_of(server) if isinstance(one, PlatformCommand))
            assert found.values.tolist() == pytest.approx([angle])
            assert found.servos.tolist() == [SERVO]


def orders_of(server: RosServer) -> list[Any]:
    return [order for message in server._poll() for order in message.orders]
