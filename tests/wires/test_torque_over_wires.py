"""Torques that a behaviour sends over a middleware end when the joint data from which they were computed
become too old."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
import pytest

import tci
from helpers.patient import patient
from helpers.wire_peers import wire
from tci.drivers.registry import open_server
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError
from tci.gate.safe_command import SafeCommand
from tci.lab.experiments.remote_trial import TrialDriver
from tci.messages import Mode, PlatformCommand, PlatformSwitch, Reading
from tci.robot.description import Robot
from tci.runtime.serve import serve

PATIENCE = 20.0
"""Longest time [s] until a torque is sent on a busy machine."""
END = 0.05
"""Time [s] after the last reading within which torques must end."""
PUSH = 0.3
"""Torque [N m] that the behaviour requests without end."""
FAULTS = "repeats", "repeats under new stamps", "raises"


def torque_robot() -> Robot:
    """Returns a NAO whose left elbow supports torque mode."""
    robot = patient("nao")
    servos = tuple(
        servo.model_copy(update={"modes": (Mode.POSITION, Mode.TORQUE)})
        if servo.index == elbow(robot)
        else servo
        for servo in robot.servos
    )
    return robot.model_copy(update={"servos": servos})


def elbow(robot: Robot) -> int:
    return next(servo.index for servo in robot.servos if servo.name == "LElbowRoll")


class Owner(SimulatedDriver):
    """The robot's own driver, whose readings can be made to fail. Records the torques that are sent."""

    fault = "none"

    def __init__(self, robot: Robot) -> None:
        super().__init__(robot, paced=True)
        self.sent: list[tuple[float, float]] = []
        """Times [s] and torques [N m] of the elbow."""
        self.since = np.inf
        """Stamp [s] of the last reading before the fault."""
        self._last: Reading | None = None

    def _receive(self) -> Reading:
        reading, before = super()._receive(), self._last
        if self.fault == "none" or before is None:
            self._last = reading
            return reading
        self.since = min(self.since, before.joints.stamp)
        if self.fault == "raises":
            raise DriverError("reading fails, on purpose")
        stamp = before.joints.stamp if self.fault == "repeats" else reading.joints.stamp
        return replace(reading, joints=replace(before.joints, stamp=stamp))

    def _send(self, safe: SafeCommand) -> None:
        super()._send(safe)
        place = np.flatnonzero(safe.servos == elbow(self.robot))
        if place.size:
            self.sent.append((safe.stamp, float(safe.torque[place[0]])))


@contextmanager
def served(owner: Owner, via: str) -> Iterator[tuple[str, threading.Thread]]:
    """Serves a robot in a thread. Yields the address of the robot, and the thread."""
    with TrialDriver(owner) as driver, open_server(driver, via) as server:

        def loop() -> None:
            with suppress(DriverError):
                serve(server)

        thread = threading.Thread(target=loop)
        thread.start()
        try:
            yield server.reach(), thread
        finally:
            driver.until = 0.0
            thread.join()


CASES = [("zenoh", fault) for fault in FAULTS] + [(name, FAULTS[0]) for name in ("lcm", "ros2", "yarp")]
"""Middlewares over which a robot may be in torque mode, each with a fault of the readings in the robot's
process. ROS 1 and rosbridge share ROS 2's code."""


@pytest.mark.parametrize(("name", "fault"), CASES)
def test_28_torques_end_with_the_joint_data_of_a_served_robot(name: str, fault: str) -> None:
    """The robot's behaviour continues to request a torque, and the connection works."""
    robot = torque_robot()
    index = np.array([elbow(robot)])
    push = PlatformCommand(Mode.TORQUE, index, np.array([PUSH]), np.ones(1))
    owner = Owner(robot)

    def pushed() -> bool:
        return bool(owner.sent) and owner.sent[-1][1] > 0.5 * PUSH

    with (
        wire(name) as via,
        served(owner, via) as (reach, loop),
        tci.connect(robot, reach, arm=True) as driver,
    ):

        def command(until: Callable[[], bool]) -> None:
            for now in driver.ticks(duration=PATIENCE):
                switched = driver.gate.modes[index[0]] is Mode.TORQUE
                order = push if switched else PlatformSwitch(index, Mode.TORQUE)
                driver.write(driver.gate.step([order], driver.read().joints, now))
                if until():
                    return
            raise AssertionError(f"{owner.sent[-3:]}")

        command(pushed)
        owner.fault = fault
        command(lambda: not loop.is_alive() or owner.sent[-1][0] > owner.since + 3 * END)
    assert not any(torque for stamp, torque in owner.sent if stamp > owner.since + END)
    assert owner.sent[-1][1] == 0.0
