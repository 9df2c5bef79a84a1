"""A speed in a command is a bound for the generic joints, measured on simulated robots."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.body.posture import to_platform
from tci.errors import CommandError
from tci.messages import CartesianCommand, GenericCommand, Mode, PlatformCommand, SwitchMode
from tci.messages.frames import Array
from tci.robot.clearance import without_skin
from tci.robot.joint_map import initial_position, joint_map

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
MOTIONS = 3
SETTLES = 0.3
"""Time [s] after a second command in which joints that were faster may slow down."""


def arms(robot: tci.Robot) -> list[str]:
    return [part.name for part in robot.parts if part.kind == "arm"]


def random_posture(robot: tci.Robot, part: str, random: np.random.Generator) -> Array:
    """Returns generic angles that the servos reach, not near 90 degrees of abduction."""
    joints, position = joint_map(robot, part), np.array(initial_position(robot))
    while True:
        for servo in joints.servos.tolist():
            limits = robot.servos[servo].limits
            position[servo] = 0.9 * random.uniform(limits.lower or 0.0, limits.upper or 0.0)
        generic = joints.to_generic(position)
        if abs(generic[1]) < np.deg2rad(70.0) and np.abs(generic).max() < np.pi:
            return generic


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("nao", Mode.POSITION),
        ("talos", Mode.POSITION),
        ("icub", Mode.VELOCITY),
        ("alex", Mode.VELOCITY),
        ("icub", Mode.IMPEDANCE),
        ("g1", Mode.IMPEDANCE),
    ],
)
def test_no_joint_is_measured_faster_than_the_command_allows(name: str, mode: Mode) -> None:
    random = np.random.default_rng(ROBOTS.index(name))
    with tci.connect(without_skin(tci.load_robot(name)), "sim") as driver:
        robot, body = driver.robot, GenericBody(driver.robot)
        parts = [part for part in arms(robot) if mode in robot.servos[body.joint_maps[part].servos[0]].modes]
        moved = 0.0
        for motion in range(MOTIONS):
            orders: list[GenericCommand | SwitchMode] = []
            speeds: dict[str, Array] = {}
            for part in parts:
                # a compliant joint that is asked to be much slower than the rest of its arm is shaken by it
                spread = 0.2 if mode is Mode.IMPEDANCE else 0.9
                speeds[part] = random.uniform(0.3, 1.0) * random.uniform(1.0 - spread, 1.0, 5)
                target = random_posture(robot, part, random)
                if mode is Mode.VELOCITY:
                    here = body.posture(driver.read().joints)[part]
                    target = np.sign(target - here) * random.uniform(0.5, 2.0) * speeds[part]
                orders += [SwitchMode(part, mode)] if motion == 0 else []
                orders.append(GenericCommand(part, mode, target, speed=speeds[part]))
            moved = max(moved, drive(driver, body, orders, speeds, SETTLES * (motion > 0)))
        assert moved > 0.5, "half of an allowed speed was used"


def drive(
    driver: tci.Driver,
    body: GenericBody,
    orders: list[GenericCommand | SwitchMode],
    speeds: Mapping[str, Array],
    settles: float,
) -> float:
    """Executes commands for a while. Returns the largest measured speed, as a fraction of the allowed one.
    Joints that were faster may slow down for the time `settles` [s]."""
    begun, most, before = driver.clock.now(), 0.0, None
    for now in driver.ticks(duration=0.8):
        reading = driver.read()
        platform, refused = body.to_platform(orders, reading.joints)
        orders = [order for order in orders if isinstance(order, GenericCommand)]
        assert not refused
        safe = driver.gate.step(platform, reading.joints, now)
        assert not safe.refusals
        assert safe.state.value == "run", safe.reason
        driver.write(safe)
        posture = body.posture(reading.joints)
        if before is not None and now - begun > settles:
            for part, speed in speeds.items():
                measured = np.abs(posture[part] - before[part]) / driver.period
                most = max(most, float((measured / speed).max()))
                assert (measured <= 1.02 * speed).all(), (part, measured / speed)
        before = posture
    return most


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.IMPEDANCE])
def test_the_servos_speeds_keep_the_joints_speed_all_along_the_way(name: str, mode: Mode) -> None:
    """The servos may move one after the other: each corner of the box between start and target is a way."""
    random, robot = np.random.default_rng(7), tci.load_robot(name)
    for part in arms(robot):
        joints, position = joint_map(robot, part), np.array(initial_position(robot))
        for _ in range(20):
            start = joints.to_robot(random_posture(robot, part, random), position)
            position[joints.servos] = start
            target = random_posture(robot, part, random)
            most = random.uniform(0.05, 2.0, 5)
            command = to_platform(robot, GenericCommand(part, mode, target, most), position=position)
            for share in np.linspace(0.0, 1.0, 30):
                there = position.copy()
                there[joints.servos] += share * (command.values - start)
                fastest = np.abs(joints.slope(there)) @ command.speed
                assert (fastest <= 1.02 * most[joints.ids]).all()


def test_one_number_counts_for_all_joints() -> None:
    robot = tci.load_robot("nao")
    one = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.zeros(5), 0.3))
    each = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.zeros(5), [0.3] * 5))  # type: ignore[arg-type]
    np.testing.assert_array_equal(one.speed, each.speed)
    assert one.speed.max() == pytest.approx(0.85 * 0.3), "with a reserve"
    none = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.zeros(5)))
    assert none.speed.min() > 0.3
    unbound = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, np.zeros(5), np.inf))
    np.testing.assert_array_equal(unbound.speed, none.speed)


@pytest.mark.parametrize("speed", [0.0, -1.0, np.nan, [0.1, 0.2], [0.1, 0.1, 0.0, 0.1, 0.1], np.ones((1, 5))])
def test_a_bad_speed_is_refused_in_one_clear_sentence(speed: object) -> None:
    robot = tci.load_robot("nao")
    for command in (
        GenericCommand("left_arm", Mode.POSITION, np.zeros(5), speed),  # type: ignore[arg-type]
        GenericCommand("left_arm", Mode.VELOCITY, np.zeros(5), speed),  # type: ignore[arg-type]
    ):
        with pytest.raises(
            CommandError, match=r"speed of left_arm: .*; valid: above 0 rad/s, one number or 5"
        ):
            to_platform(robot, command)


def test_a_speed_is_a_number() -> None:
    with pytest.raises(CommandError, match=r"speed of left_arm: .*; valid: numbers"):
        GenericCommand("left_arm", Mode.POSITION, np.zeros(5), "slow")  # type: ignore[arg-type]


@pytest.mark.parametrize("mode", [Mode.TORQUE, Mode.STIFFNESS])
def test_a_mode_without_a_way_has_no_speed(mode: Mode) -> None:
    with pytest.raises(
        CommandError, match=f"none in {mode.value} mode; valid in: position, impedance, velocity"
    ):
        to_platform(tci.load_robot("icub"), GenericCommand("left_arm", mode, np.zeros(5), 0.5))


def test_a_velocity_keeps_its_direction() -> None:
    robot, values = tci.load_robot("nao"), np.array([0.5, -1.0, 0.2, 0.1, 0.0])
    fast = to_platform(robot, GenericCommand("left_arm", Mode.VELOCITY, values))
    slow = to_platform(robot, GenericCommand("left_arm", Mode.VELOCITY, values, 0.4))
    np.testing.assert_allclose(slow.values, 0.85 * 0.4 * fast.values)


def test_a_cartesian_command_has_a_speed_too() -> None:
    body = GenericBody(tci.load_robot("nao"))
    with tci.connect(body.robot, "sim") as driver:
        joints = driver.read().joints
    target = body.reach("left_arm").place(joints.position)
    (order,), _ = body.to_platform(CartesianCommand("left_arm", target, speed=0.2), joints)
    assert isinstance(order, PlatformCommand)
    assert order.speed.max() <= 0.2 + 1e-12
    _, (refusal,) = body.to_platform(CartesianCommand("left_arm", target, speed=-0.2), joints)
    assert "valid: above 0 rad/s" in refusal.text
