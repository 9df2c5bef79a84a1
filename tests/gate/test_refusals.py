"""Each refusal, hold and stop of the gate has its code, names its cause, and begins exactly at its limit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from helpers.gate_checks import LIMITS, PERIOD, Driven, make_robot, position_command, reading
from tci.errors import CommandError, DriverError, TciError
from tci.gate.acceptance import OUTSIDE, by_servo, fault_of_reading, is_likely_degrees, refuse_far
from tci.gate.bounds import bounds_of
from tci.gate.gate import Gate, GateSettings, GateState
from tci.gate.stop_plan import StopTrajectory
from tci.gate.trajectory import OnlineTrajectory
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.reasons import Code, Reason
from tci.robot.description import Robot

ZERO = [0.0] * 6
STALE = 0.05
TURN = 2.0 * np.pi
ROBOT = make_robot(limits=LIMITS.model_copy(update={"torque": 5.0}), modes=CONTROL_MODES)
NEAR = Reason(Code.SELF_COLLISION, "near")


def switch(servos: Sequence[int], mode: Mode) -> PlatformSwitch:
    return PlatformSwitch(np.array(servos, np.intp), mode)


def with_limits(**changes: float | None) -> Robot:
    """Returns the robot of these tests with other limits, which a description would not pass."""
    return make_robot(limits=LIMITS.model_copy(update=changes), modes=CONTROL_MODES)


TWICE = "joint2 was switched in this period; valid: one mode at a time"
UNMOVED = "joint2 can't be moved: its"


@pytest.mark.parametrize(
    ("robot", "orders", "code", "words"),
    [
        (make_robot(), [switch([2], Mode.TORQUE)], Code.WRONG_MODE,
         "tester: joint2 has no torque mode; valid: position"),
        (ROBOT, [switch([2], Mode.STIFFNESS)], Code.COMMAND_INVALID,
         "switch to stiffness; valid: position, velocity, torque, impedance"),
        (ROBOT, [switch([], Mode.TORQUE)], Code.COMMAND_INVALID,
         "switch of (0,) servos; valid: at least one"),
        (ROBOT, [PlatformSwitch(np.zeros((1, 1), np.intp), Mode.TORQUE)], Code.COMMAND_INVALID,
         "switch of (1, 1) servos; valid: at least one"),
        (ROBOT, [PlatformCommand(Mode.POSITION, np.array([[2]]), np.zeros((1, 1)), np.ones((1, 1)))],
         Code.COMMAND_INVALID,
         "position: (1, 1) servos and (1, 1) values; valid: as many values as servos, at least one"),
        (ROBOT, [PlatformCommand(Mode.POSITION, np.arange(3), np.zeros(2), np.ones(2))], Code.COMMAND_INVALID,
         "position: (3,) servos and (2,) values; valid: as many values as servos, at least one"),
        (ROBOT, [switch([6], Mode.TORQUE)], Code.COMMAND_INVALID, "switch: servos [6]; valid: 0 to 5"),
        (ROBOT, [PlatformSwitch(np.array([1.0]), Mode.TORQUE)], Code.COMMAND_INVALID,
         "switch: servos [1.0]; valid: 0 to 5"),
        (with_limits(), [switch([2], Mode.TORQUE)], Code.LIMITS_UNKNOWN,
         "joint2 has no torque mode: its description has no limit of torque"),
        (with_limits(torque=0.0), [switch([2], Mode.TORQUE)], Code.LIMITS_UNKNOWN,
         "joint2 has no torque mode: its description has no limit of torque"),
        (with_limits(torque=np.inf), [switch([2], Mode.TORQUE)], Code.LIMITS_UNKNOWN,
         "joint2 has no torque mode: its description has no limit of torque"),
        (with_limits(jerk=None, lower=None), [position_command([2], [0.1])], Code.LIMITS_UNKNOWN,
         f"{UNMOVED} description has no limit of lower, jerk"),
        (with_limits(velocity=0.0), [position_command([2], [0.1])], Code.LIMITS_UNKNOWN,
         f"{UNMOVED} limit of velocity is 0; valid: above 0 and finite"),
        (with_limits(jerk=np.inf), [position_command([2], [0.1])], Code.LIMITS_UNKNOWN,
         f"{UNMOVED} limit of jerk is inf; valid: above 0 and finite"),
        (with_limits(lower=3.0), [position_command([2], [0.1])], Code.LIMITS_UNKNOWN,
         f"{UNMOVED} limits are 3 .. 2 rad; valid: lower first"),
        (ROBOT, [PlatformCommand(Mode.VELOCITY, np.array([2]), np.zeros(1), np.ones(1))], Code.WRONG_MODE,
         "joint2 is in position mode, the command is in velocity mode; valid: switch the mode first"),
        (ROBOT, [switch([2], Mode.VELOCITY), switch([2], Mode.IMPEDANCE)], Code.WRONG_MODE, TWICE),
        (ROBOT, [switch([2], Mode.TORQUE), switch([2], Mode.IMPEDANCE)], Code.WRONG_MODE, TWICE),
        (make_robot(), [position_command([2, 3, 4], [0.1, 0.2, 7.0])], Code.LIMITS_EXCEEDED,
         "position of joint2, joint3, joint4: joint4 at 7 rad is more than a full turn; "
         "valid: -1.00 .. 2.00 rad"),
        (make_robot(), [position_command([2, 3], [-6.5, 0.1])], Code.LIKELY_DEGREES,
         "position of joint2, joint3: joint2 at -6.5 rad, limits -1.00 .. 2.00 rad; degrees? "
         "valid: radians, as from np.deg2rad"),
    ],
)  # fmt: skip
def test_an_order_is_refused_with_its_code_and_its_cause(
    robot: Robot, orders: list[PlatformOrder], code: Code, words: str
) -> None:
    safe = Driven(robot, ZERO).step(*orders)
    assert [(one.code, str(one)) for one in safe.refusals] == [(code, words)]


@pytest.mark.parametrize("types", [(np.int32, float, float), (np.intp, np.float32, float),
                                   (np.intp, float, np.float32)])  # fmt: skip
def test_a_command_with_one_array_of_another_type_counts_too(types: tuple[type, type, type]) -> None:
    usual = position_command([2, 3], [0.5, 0.25], 1.0)
    arrays = zip((usual.servos, usual.values, usual.speed), types, strict=True)
    servos, values, speed = (array.astype(kind) for array, kind in arrays)
    driven = Driven(ROBOT, ZERO)
    assert not driven.step(PlatformCommand(Mode.POSITION, servos, values, speed)).refusals
    assert driven.gate.targets.tolist() == [0.5, 0.25]


def test_a_command_in_another_mode_is_refused_also_to_servos_that_move_already() -> None:
    driven, command = Driven(ROBOT, ZERO), position_command([2, 3], [0.5, 0.25])
    for _ in range(3):
        assert not driven.step(command).refusals
    (refusal,) = driven.step(replace(command, mode=Mode.IMPEDANCE)).refusals
    assert refusal.code is Code.WRONG_MODE


def test_a_servo_that_was_pushed_far_outside_does_not_keep_others_from_joining() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=STALE, settings=GateSettings(monitor=None))
    angles = np.zeros(6)
    gate.step([switch([2], Mode.IMPEDANCE)], reading(angles), 0.0)
    angles[2] = 2.1 + OUTSIDE
    safe = gate.step([switch([3], Mode.IMPEDANCE)], reading(angles, PERIOD), PERIOD)
    assert (safe.refusals, safe.servos.tolist()) == ((), [2, 3])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_coupling_is_kept_beside_a_servo_that_nobody_commands(side: float) -> None:
    robot = make_robot(limits=LIMITS.model_copy(update={"lower": -2.0}))
    driven = Driven(robot, [0.0, 0.5 * side, 0.0, 0.0, 0.0, 0.0])
    driven.step(position_command([0], [1.9 * side]))
    driven.settle()
    assert driven.angles[0] == pytest.approx(1.3 * side, abs=1e-4)
    driven.assert_within_limits()


@pytest.mark.parametrize("how", ["reference", "measured"])
def test_a_servo_that_moves_is_not_switched_at_once(how: str) -> None:
    driven, velocity = Driven(ROBOT, ZERO), np.zeros(6)
    if how == "reference":
        driven.step(position_command([2], [1.0]))
        for _ in range(30):
            driven.step()
    else:
        velocity[2] = -0.1
    joints = replace(reading(driven.angles, driven.time), velocity=velocity)
    safe = driven.gate.step([switch([2], Mode.VELOCITY), switch([3], Mode.VELOCITY)], joints, driven.time)
    (told,) = safe.clamped
    assert (told.code, told.names) == (Code.SWITCHES_AT_REST, ("joint2",))
    assert driven.gate.modes[2:4] == (Mode.POSITION, Mode.VELOCITY)


@pytest.mark.parametrize(
    ("end", "side", "limits"), [(2.0, 1.0, "-57.3 .. 114.6"), (-1.0, -1.0, "-57.3 .. 114.6")]
)
def test_a_servo_comes_under_command_up_to_20_degrees_outside_its_limits(
    end: float, side: float, limits: str
) -> None:
    start = [*ZERO]
    start[2] = end + side * OUTSIDE
    assert not Driven(make_robot(), start).step(position_command([2], [0.5])).refusals
    start[2] += side * 0.01
    (refusal,) = Driven(make_robot(), start).step(position_command([2], [0.5])).refusals
    measured = f"{np.rad2deg(start[2]):.1f}"
    assert refusal.code is Code.LIMITS_EXCEEDED
    assert str(refusal) == (
        f"joint2 is measured at {measured} degrees, its limits are {limits}; valid: at most 20 outside"
    )


def test_a_gate_that_holds_or_has_stopped_refuses_with_its_reason() -> None:
    driven = Driven(make_robot(), ZERO)
    for act, state in ((driven.gate.hold, "hold"), (driven.gate.stop, "stop")):
        act("it smokes")
        (refusal,) = driven.step(position_command([2], [0.1])).refusals
        assert (refusal.code, str(refusal)) == (Code.GATE_CLOSED, f"{state}: it smokes")


@pytest.mark.parametrize(
    ("position", "velocity", "code", "words"),
    [
        (np.zeros(5), np.zeros(6), Code.JOINTS_MISFIT, "joint reading of shape (5,); valid: (6,)"),
        (np.zeros(6), np.zeros(7), Code.JOINTS_MISFIT, "joint velocities of shape (7,); valid: (6,)"),
        (np.array([0, 0, 0, np.nan, 0, np.inf]), np.zeros(6), Code.JOINTS_MISFIT,
         "the angle of joint3 is not finite"),
    ],
)  # fmt: skip
def test_joint_data_that_can_not_be_used_is_named(
    position: np.ndarray, velocity: np.ndarray, code: Code, words: str
) -> None:
    joints = JointReading(0.0, 0, position, velocity)
    assert fault_of_reading(ROBOT, joints, 0.0, STALE) == Reason(code, words)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_joint_data_is_too_old_or_too_new_beyond_exactly_what_is_allowed(side: float) -> None:
    assert fault_of_reading(ROBOT, reading(ZERO), side * STALE, STALE) is None
    old = fault_of_reading(ROBOT, reading(ZERO), np.nextafter(side * STALE, side), STALE)
    assert old == Reason(Code.JOINTS_STALE, f"joint data is {side * 50:.1f} ms old; valid: at most 50 ms")
    late = fault_of_reading(ROBOT, reading(ZERO), side * 2.0, 1.0)
    assert late == Reason(
        Code.JOINTS_STALE, f"joint data is {side * 2000:.1f} ms old; valid: at most 1000 ms"
    )


@pytest.mark.parametrize(
    ("period", "stale_after"),
    [(0.0, 0.05), (np.nan, 0.05), (np.inf, 0.05), (0.002, 0.0), (0.002, np.nan), (0.002, np.inf)],
)
def test_a_gate_needs_times_above_0_and_finite(period: float, stale_after: float) -> None:
    words = f"period {period} s, stale_after {stale_after} s; valid: above 0 and finite"
    with pytest.raises(TciError) as refused:
        Gate(ROBOT, period=period, stale_after=stale_after)
    assert str(refused.value) == words


def test_each_order_of_a_step_is_clamped_reported_and_taken() -> None:
    driven = Driven(ROBOT, ZERO)
    shares = (PlatformCommand(mode, np.array([4]), np.array([1.5]), np.ones(1))
              for mode in (Mode.STIFFNESS, Mode.DAMPING))  # fmt: skip
    orders = (position_command([2], [3.0]), position_command([3], [-2.0]), *shares)
    safe = driven.step(*orders)
    assert [str(one).partition(" asked")[0] for one in safe.clamped] == [
        "joint2: 3.00 rad (171.89 degrees)", "joint3: -2.00 rad (-114.59 degrees)",
        "joint4: 1.50 stiffness", "joint4: 1.50 damping",
    ]  # fmt: skip
    assert safe.orders == orders
    assert (dict(safe.stiffness), dict(safe.damping)) == ({4: 1.0}, {4: 1.0})
    assert driven.gate.counts.clamps == {"joint2": 1, "joint3": 1, "joint4": 2}
    after = driven.step()
    assert (after.orders, after.clamped, dict(after.stiffness), dict(after.damping)) == ((), (), {}, {})


def test_a_new_gate_runs_without_servos() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=STALE)
    assert (gate.state, gate.reason, gate.targets.size) == (GateState.RUN, None, 0)
    assert (gate.period, gate.stale_after, gate.robot) == (PERIOD, STALE, ROBOT)


def test_data_that_repeats_is_as_old_as_its_first_copy() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=STALE)
    for now, state in ((0.0, GateState.RUN), (STALE, GateState.RUN), (0.06, GateState.HOLD)):
        safe = gate.step((), replace(reading(ZERO), stamp=now), now)
        assert safe.state is state
    assert safe.reason == Reason(Code.JOINTS_STALE, "no new joint data for 60 ms")


def test_a_gate_that_has_never_had_good_data_says_so() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=STALE)
    bad = reading([*ZERO[1:], np.nan])
    assert "not finite" in str(gate.step((), bad, 0.0).reason)
    again = replace(bad, position=np.zeros(6), stamp=PERIOD)
    assert gate.step((), again, PERIOD).reason == Reason(Code.JOINTS_STALE, "no new joint data yet")


def test_a_time_that_goes_back_stops_the_robot() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=STALE)
    gate.step((), reading(ZERO, 1.0), 1.0)
    assert gate.step((), reading(ZERO, 1.0 - 0.9 * PERIOD), 1.0 - 0.9 * PERIOD).reason is None
    safe = gate.step((), reading(ZERO, 0.5), 0.5)
    assert safe.reason == Reason(Code.TIME_WENT_BACK, "time went back by 0.500 s")


def test_what_was_written_before_is_refused_in_these_words() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=STALE)
    safe = gate.step((), reading(ZERO), 0.0)
    gate.check_out(safe)
    with pytest.raises(DriverError) as refused:
        gate.check_out(safe)
    assert str(refused.value) == (
        "not the latest command of this driver's gate, or written before; "
        "valid: write(gate.step(...)), once per step"
    )


def test_an_angle_that_stays_while_its_torque_rises_is_that_of_a_frozen_encoder() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.TORQUE))
    push = PlatformCommand(Mode.TORQUE, np.array([2]), np.array([4.0]), np.ones(1))
    for _ in range(300):
        safe = driven.step(push)
    assert safe.reason is not None
    assert safe.reason.code is Code.ENCODER_FROZEN
    assert safe.reason.text.startswith("the encoder of joint2 stands still whatever the torque; ")


def test_a_full_turn_is_no_degrees_yet() -> None:
    assert not is_likely_degrees(np.array([TURN, -TURN, 0.1, 0.1, 0.1]))
    assert is_likely_degrees(np.nextafter([TURN, -TURN, 0.1, 0.1, 0.1], [9.0, -9.0, 0.0, 0.0, 0.0]))
    for angle, code in ((TURN, Code.LIKELY_DEGREES), (np.nextafter(TURN, 9.0), Code.LIMITS_EXCEEDED)):
        with pytest.raises(CommandError) as refused:
            refuse_far(make_robot(), position_command([2, 3, 4], [angle, 0.1, 0.1]))
        assert refused.value.reason.code is code


@pytest.mark.parametrize("end", [-1.0, 2.0])
def test_an_angle_at_its_limit_is_not_a_wrong_one(end: float) -> None:
    """The wrong angle is named, although its magnitude is smaller."""
    robot = make_robot()
    first = robot.servos[2].limits.model_copy(update={"lower": -1.0, "upper": 2.0})
    narrow = first.model_copy(update={"lower": 0.1, "upper": 0.2})
    servos = [one.model_copy(update={"limits": narrow}) if one.index == 3 else one for one in robot.servos]
    robot = robot.model_copy(update={"servos": tuple(servos)})
    with pytest.raises(CommandError, match=r"joint3 at 0\.3 rad"):
        refuse_far(robot, position_command([2, 3], [end, 0.3]))


def test_an_unknown_limit_is_not_a_number_among_bounds() -> None:
    robot = make_robot(coupled=False, limits=LIMITS.model_copy(update={"upper": None, "jerk": None}))
    bounds, _ = bounds_of(robot, [0, 1], speed_share=0.5)
    assert np.isnan([bounds.upper, bounds.jerk]).all()
    assert bounds.lower.tolist() == [LIMITS.lower] * 2
    assert bounds.velocity.tolist() == [0.5 * LIMITS.velocity] * 2


def test_each_servo_has_one_value() -> None:
    assert by_servo(np.array([3, 1]), np.array([0.5, 0.25])) == {3: 0.5, 1: 0.25}
    with pytest.raises(ValueError, match="longer"):
        by_servo(np.array([3]), np.array([0.5, 0.25]))


def guarded(guard: Callable[[StopTrajectory], Reason | None]) -> OnlineTrajectory:
    bounds, _ = bounds_of(make_robot(coupled=False), [0, 1, 2], speed_share=1.0)
    return OnlineTrajectory(bounds, np.zeros(3), PERIOD, guard=guard)


def test_a_motion_that_is_not_taken_over_has_the_code_of_its_fault() -> None:
    moving = guarded(lambda stop: None)
    moving.aim(np.full(3, 0.5), np.full(3, 1.0))
    for _ in range(50):
        moving.step()
    with pytest.raises(CommandError) as refused:
        guarded(lambda stop: NEAR).take_over([0, 1, 2], moving, [0, 1, 2])
    assert refused.value.reason == Reason(NEAR.code, "these servos can't join the motion now: near")


def test_a_servo_that_is_taken_over_keeps_the_angle_at_which_it_was_found() -> None:
    before, after = guarded(lambda stop: None), guarded(lambda stop: None)
    before.found[:] = 0.1, 0.2, 0.3
    after.take_over([0, 2], before, [1, 2])
    assert after.found.tolist() == [0.2, 0.0, 0.3]
