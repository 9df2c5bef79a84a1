"""A served G1 moves like the motors of a real G1."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import tci
from helpers.dds_domains import DOMAINS
from helpers.served import Served
from tci.body.generic_body import order_to_platform
from tci.drivers.simulated import SimulatedDriver
from tci.messages import Order, Perception, Reading
from tci.messages.frames import Array
from tci.wires.unitree import messages
from tci.wires.unitree.driver import slots_of
from tci.wires.unitree.motors import ARM_GAINS, MOTORS, NAMES
from tci.wires.unitree.server import VARIANT, UnitreeServer
from tci.wires.unitree.wire import COMMAND, WEIGHT, decode_state, encode_command

ROBOT = tci.load_robot("g1")
ELBOW = NAMES.index("left_elbow_joint")
SERVO = next(servo.index for servo in ROBOT.servos if servo.name == NAMES[ELBOW])
RATE = 250.0
MOVED = float(np.deg2rad(0.05))


class Stream:
    """Commands of weight 1, one for every second period of the robot. They replace received commands."""

    def __init__(self, posture: Array, angles: Array, speeds: Array) -> None:
        self._left = [*zip(angles, speeds, strict=True)][::-1]
        self._command: Any = np.zeros((), COMMAND)
        self._command["mode_machine"] = VARIANT
        motor = self._motor = self._command["motor"]
        motor["mode"][12:29], motor["q"][WEIGHT] = 1, 1.0
        motor["q"][slots_of(ROBOT)] = posture
        motor["kp"][:MOTORS], motor["kd"][:MOTORS] = ARM_GAINS["kp"], ARM_GAINS["kd"]
        self._count = 0

    def take(self, most: int) -> list[Any]:
        self._count += 1
        if self._count % 2 or not self._left:
            return []
        self._motor["q"][ELBOW], self._motor["dq"][ELBOW] = self._left.pop()
        sample: Any = messages.COMMAND.__new__(messages.COMMAND)
        sample.raw = encode_command(self._command)
        return [sample]


def references(
    driver: SimulatedDriver, orders: Callable[[Reading], Sequence[Order]], server: UnitreeServer | None = None
) -> tuple[Array, Array]:
    """Executes orders, one each period, and returns the angles and speeds of the elbow's reference."""
    angles, speeds = [driver.read().joints.position[SERVO]], [0.0]
    for now in driver.ticks(duration=0.8):
        reading = driver.read()
        made = [order_to_platform(ROBOT, one, reading.joints.position) for one in orders(reading)]
        sent = driver.write(driver.gate.step(made, reading.joints, now))
        assert not sent.refusals
        place = np.flatnonzero(sent.servos == SERVO)
        angles.append(sent.position[place[0]] if len(place) else angles[-1])
        speeds.append(sent.velocity[place[0]] if len(place) else 0.0)
        if server is not None:
            server.publish(reading, Perception(now, {}, ()), sent)
    return np.array(angles), np.array(speeds)


def test_a_stream_of_set_points_is_followed_without_a_second_start() -> None:
    with SimulatedDriver(ROBOT, rate=RATE) as client:
        posture = client.read().joints.position
        order = [client.native("left_arm").command({NAMES[ELBOW]: posture[SERVO] + 0.25})]
        angles, speeds = references(client, lambda reading: order if reading.joints.sequence == 0 else ())
    with (
        SimulatedDriver(ROBOT, rate=2.0 * RATE) as driver,
        UnitreeServer(driver, f"lo/{next(DOMAINS)}") as server,
    ):
        server._arms = Stream(posture, angles, speeds)
        followed, _ = references(driver, lambda reading: server.orders(), server)
    begins = [np.argmax(np.abs(found - posture[SERVO]) > MOVED) for found in (angles, followed)]
    assert abs(followed[-1] - angles[-1]) < 1e-4
    assert begins[1] / (2.0 * RATE) - begins[0] / RATE <= 0.008 + 1e-9
    assert followed.max() - angles[-1] < 0.002


def test_a_reading_that_came_once_is_shown_once() -> None:
    """State messages contain no time of measurement. A repeated message would look new, and its client would
    continue to move."""
    shown: list[int] = []

    def keep(state: bytes) -> None:
        shown.append(int(decode_state(state)[0]["tick"]))

    with SimulatedDriver(ROBOT, rate=RATE) as driver, UnitreeServer(driver, f"lo/{next(DOMAINS)}") as server:
        server._states, reading = keep, driver.read()
        for now in driver.ticks(duration=0.04):
            reading = driver.read() if now < 0.02 else reading
            joints = replace(reading.joints, stamp=now)
            sent = driver.write(driver.gate.step((), joints, now))
            server.publish(replace(reading, joints=joints), Perception(now, {}, ()), sent)
    assert shown == [0, 4, 8, 12, 16]


def test_a_source_beside_a_g1_feels_a_patch_that_no_hand_of_the_g1_reads() -> None:
    via = f"unitree:lo/{next(DOMAINS)}"
    robot = Served("g1", via)
    try:
        with tci.connect("g1", f"{via} + array:feed,patch=left_forearm") as driver:
            assert [patch.name for patch in driver.robot.patches] == ["left_forearm"]
            driver.feed("left_forearm", np.full(driver.robot.patch("left_forearm").channels, 7.0))
            end = time.monotonic() + 5.0
            while not any((frame.values == 7.0).all() for frame in driver.read().skin):
                assert time.monotonic() < end, "no frame of the source"
                time.sleep(0.01)
    finally:
        robot.kill()
