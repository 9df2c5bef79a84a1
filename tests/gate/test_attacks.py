"""Attacks that might make the gate pass a forbidden command, or did so in earlier versions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from helpers.gate_checks import LIMITS, PERIOD, Driven, make_robot, position_command, reading
from helpers.hostile_commands import CYCLE, Attack
from tci.errors import CommandError
from tci.gate.gate import Gate, GateState
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformSwitch
from tci.messages.frames import read_only
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot

ZERO = [0.0] * 6
ROBOT = make_robot(limits=LIMITS.model_copy(update={"torque": 5.0}), modes=CONTROL_MODES)


def switch(servos: Sequence[int], mode: Mode) -> PlatformSwitch:
    return PlatformSwitch(np.array(servos, dtype=np.intp), mode)


def share(mode: Mode, servo: int, value: float) -> PlatformCommand:
    return PlatformCommand(mode, np.array([servo]), np.array([value]), np.ones(1))


def moving(robot: Robot = ROBOT) -> Driven:
    """Returns a gate whose reference is moving."""
    driven = Driven(robot, ZERO)
    driven.step(position_command([2], [1.5]))
    for _ in range(80):
        driven.step()
    return driven


@pytest.mark.parametrize(
    ("name", "streams"), [("tester", True), ("tester", False), ("icub", True), ("nao", False), ("g1", False)]
)
def test_hostile_commands_in_all_modes(name: str, streams: bool) -> None:
    robot = ROBOT if name == "tester" else load_robot(name)
    attack = Attack(robot, seed=5, body=False, streams=streams)
    for _ in range(8 * CYCLE + 100):
        attack.step()
    assert attack.judge.faults == []
    assert attack.counts.malformed > attack.counts.passed == 0
    assert (attack.switched > 20) == streams, "modes change in motion, or only at rest"
    assert attack.counts.modes == {mode for servo in robot.servos for mode in servo.modes}


@pytest.mark.parametrize("when", [np.nan, np.inf, -np.inf])
def test_a_time_that_is_none_moves_nothing_and_opens_no_burst(when: float) -> None:
    driven = moving()
    before = driven.gate.step([], reading(driven.angles, driven.time), driven.time).position
    safe = driven.gate.step([], reading(driven.angles, driven.time), when)
    assert safe.state is GateState.HOLD
    np.testing.assert_array_equal(safe.position, before)
    driven.angles[safe.servos] = before
    path = [driven.angles.copy()]
    for _ in range(20):  # all calls have the same time: at most one step is due
        safe = driven.gate.step([], reading(driven.angles, driven.time), driven.time)
        path.append(safe.position)
    assert len({tuple(step) for step in path[1:]}) == 1


def test_a_time_that_goes_back_stops_the_robot_and_the_stop_is_carried_out() -> None:
    driven = moving()
    driven.time -= 0.5 + PERIOD
    safe = driven.step()
    assert safe.state is GateState.STOP
    assert str(safe.reason) == "time went back by 0.500 s"
    driven.settle()
    driven.assert_within_limits()
    driven.gate.reset()
    assert driven.step(position_command([2], [0.3])).refusals == ()


def test_a_reset_in_motion_is_refused_since_the_stop_would_be_lost() -> None:
    driven = moving()
    with pytest.raises(CommandError, match="valid: reset at rest"):
        driven.gate.reset()
    driven.gate.stop("stop")
    with pytest.raises(CommandError, match="still moves"):
        driven.gate.reset()
    driven.settle()
    assert driven.gate.state is GateState.STOP
    driven.gate.reset()
    driven.assert_within_limits()


def test_two_switches_in_one_period_would_let_the_set_point_jump() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(position_command([2], [0.5]))
    driven.settle()
    told = driven.angles[2]
    driven.angles[2] += np.deg2rad(1.5)  # it sags
    safe = driven.step(switch([2], Mode.IMPEDANCE), switch([2], Mode.POSITION))
    assert [*map(str, safe.refusals)] == ["joint2 was switched in this period; valid: one mode at a time"]
    assert safe.modes == (Mode.IMPEDANCE,)
    assert safe.position[0] == told
    assert driven.step(switch([2], Mode.POSITION)).refusals == ()


def test_a_joint_that_moves_without_saying_so_is_not_switched() -> None:
    gate, angle = Gate(ROBOT, period=PERIOD, stale_after=0.05), 0.0
    unknown = read_only([np.nan] * 6)
    gate.step([switch([2], Mode.TORQUE)], JointReading(0.0, 0, read_only(ZERO), unknown), 0.0)
    for step in range(1, 100):
        angle += 1.0 * PERIOD
        joints = JointReading(step * PERIOD, step, read_only([0, 0, angle, 0, 0, 0]), unknown)
        safe = gate.step([switch([2], Mode.POSITION)] if step == 99 else [], joints, step * PERIOD)
    assert str(safe.clamped[0]) == "arm switches to position in 24 ms, at rest"
    assert safe.modes == (Mode.TORQUE,)
    for step in range(100, 300):
        joints = JointReading(step * PERIOD, step, read_only([0, 0, angle, 0, 0, 0]), unknown)
        safe = gate.step([switch([2], Mode.POSITION)] if step == 299 else [], joints, step * PERIOD)
    assert safe.refusals == ()


def test_velocities_of_another_shape_mean_hold() -> None:
    joints = JointReading(0.0, 0, read_only(ZERO), read_only([0.0] * 5))
    safe = Gate(ROBOT, period=PERIOD, stale_after=0.05).step([], joints, 0.0)
    assert safe.state is GateState.HOLD
    assert str(safe.reason) == "joint velocities of shape (5,); valid: (6,)"


@pytest.mark.parametrize(("angle", "fine"), [(2.34, True), (2.36, False), (-1.36, False), (1e30, False)])
def test_an_angle_far_outside_the_limits_is_not_sent_back_to_the_servo(angle: float, fine: bool) -> None:
    for orders in ([position_command([2], [0.0])], [switch([2], Mode.VELOCITY)]):
        gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
        safe = gate.step(orders, reading([0, 0, angle, 0, 0, 0]), 0.0)
        assert (safe.servos.size == 1) == fine
        assert fine or "joint2 is measured at" in safe.refusals[0].text


@pytest.mark.parametrize("value", [1e308, -1e308, 1e-320, np.iinfo(np.int64).min, np.iinfo(np.int64).max])
def test_huge_velocities_are_clamped(value: float) -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.VELOCITY))
    order = PlatformCommand(Mode.VELOCITY, np.array([2]), np.array([value]), np.array([1e-6]))
    fast = PlatformCommand(Mode.VELOCITY, np.array([2]), np.array([value]), np.array([np.inf]))
    for _ in range(50):
        safe = driven.step(order)
        assert np.sign(safe.velocity[0]) in (0.0, np.sign(value))
        assert abs(safe.velocity[0]) <= 1e-6 * (1 + 1e-9)
    for _ in range(300):
        driven.step(fast)
    driven.assert_within_limits()


@pytest.mark.parametrize("limit", [0.0, -5.0, np.nan, np.inf])
def test_a_torque_needs_a_limit_that_is_one(limit: float) -> None:
    robot = make_robot(limits=LIMITS.model_copy(update={"torque": limit}), modes=CONTROL_MODES)
    safe = Driven(robot, ZERO).step(switch([2], Mode.TORQUE))
    assert "no limit of torque" in safe.refusals[0].text


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lower", np.nan),
        ("lower", -np.inf),
        ("upper", np.inf),
        ("velocity", np.inf),
        ("jerk", np.nan),
        ("acceleration", -1.0),
    ],
)
def test_a_limit_that_is_none_moves_nothing(name: str, value: float) -> None:
    safe = Driven(make_robot(limits=LIMITS.model_copy(update={name: value})), ZERO).step(
        position_command([2], [0.5])
    )
    assert "joint2 can't be moved" in safe.refusals[0].text
    assert safe.servos.size == 0


@pytest.mark.parametrize(
    "changes", [{"velocity": 0.5, "acceleration": 0.5, "jerk": 0.5}, {"lower": 0.1, "upper": 0.1}]
)
def test_limits_may_be_small_and_equal(changes: dict[str, float]) -> None:
    driven = Driven(make_robot(coupled=False, limits=LIMITS.model_copy(update=changes)), [0.1] * 6)
    assert not driven.step(position_command([2], [0.1])).refusals


def test_stiffness_does_not_throw_a_limp_joint_back_to_its_equilibrium() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(share(Mode.STIFFNESS, 2, 0.5), switch([2], Mode.IMPEDANCE))
    driven.step(share(Mode.STIFFNESS, 2, 0.0))
    for _ in range(200):
        driven.angles[2] += 0.002  # the joint sinks while its equilibrium is constant
        driven.time += PERIOD
        safe = driven.gate.step([], reading(driven.angles, driven.time), driven.time)
    safe = driven.gate.step(
        [share(Mode.STIFFNESS, 2, 0.6)], reading(driven.angles, driven.time), driven.time + PERIOD
    )
    assert "from its equilibrium; valid: no more stiffness than 0.00 there" in safe.refusals[0].text
    assert safe.refusals[0].code is Code.LIMITS_EXCEEDED
    assert safe.stiffness == {}


def test_a_joint_that_rests_at_its_limit_is_not_shaken_by_the_noise_of_its_velocity() -> None:
    gate, random = Gate(ROBOT, period=PERIOD, stale_after=0.05), np.random.default_rng(0)
    gate.step([switch([2], Mode.TORQUE)], reading([0, 0, 2.0, 0, 0, 0]), 0.0)
    for step in range(1, 300):
        noise = read_only(1e-3 * random.standard_normal(6))
        joints = JointReading(step * PERIOD, step, read_only([0, 0, 2.0, 0, 0, 0]), noise)
        assert abs(gate.step([], joints, step * PERIOD).torque[0]) < 0.15


def test_period_and_settings_stay() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    for name in ("period", "stale_after", "settings", "robot"):
        with pytest.raises(AttributeError):
            setattr(gate, name, 1.0)
