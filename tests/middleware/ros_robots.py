"""What the tests of ROS 1, ROS 2 and rosbridge share."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Callable
from typing import Any

import tci
from tci.interface.safe_command import GateState
from tci.middleware.link import Link

PATCHES = {"left_forearm": 240, "right_forearm": 240, "left_upper_arm": 120, "right_upper_arm": 120}
Start = Callable[..., "subprocess.Popen[str]"]


class Programs:
    """Programs that a test started; it kills them in the end, since some do not heed a SIGTERM."""

    def __init__(self) -> None:
        self.running: list[subprocess.Popen[str]] = []

    def start(self, *command: str) -> subprocess.Popen[str]:
        environment = dict(os.environ)
        self.running.append(
            subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, env=environment
            )
        )
        return self.running[-1]

    def kill(self) -> None:
        for process in self.running:
            process.kill()
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def nao_in_ros(**more: Any) -> dict[str, Any]:
    """What a robot of ROS needs to be a NAO."""
    robot = tci.load_robot("nao")
    names = {servo.index: servo.joint or servo.name for servo in robot.servos}
    joints: dict[str, list[str]] = {}
    for servo in robot.servos:
        joints.setdefault(servo.robot_part, []).append(names[servo.index])
    position = {names[servo.index]: float(robot.initial_position[servo.index]) for servo in robot.servos}
    return {"joints": joints, "position": position, "skin": PATCHES, **more}


def drive(link: Link, *orders: Any, seconds: float) -> list[Any]:
    """Run the loop, and give what was sent."""
    pending, sent = list(orders), []
    for now in link.ticks(duration=seconds):
        sent.append(link.write(link.gate.step(pending, link.read().joints, now)))
        pending = []
    return sent


def go(link: Link, joint: str, angle: float) -> None:
    """Order it again where a pause of the machine made the robot hold."""
    arm = link.native("LArm")
    end = time.monotonic() + 30.0
    while abs(arm.positions(link.read().joints)[joint] - angle) > 0.01:
        assert link.gate.state is not GateState.STOP
        assert time.monotonic() < end
        drive(link, arm.command({joint: angle}), seconds=0.5)
