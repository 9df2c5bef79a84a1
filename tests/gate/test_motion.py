"""Control modes of the gate: velocity, torque and impedance within the limits, and changes of mode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.gate_checks import LIMITS, PERIOD, Driven, make_robot, position_command, reading
from tci.gate.bounds import MARGIN
from tci.gate.commanded_groups import CommandedGroups
from tci.gate.gate import Gate, GateSettings, GateState
from tci.gate.joint_monitor import MonitorSettings
from tci.gate.kernels.torques import RISE
from tci.gate.speeds import SMOOTHING, Speeds
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformSwitch
from tci.messages.frames import Array, read_only

ZERO = [0.0] * 6
TORQUE = 5.0
ROBOT = make_robot(limits=LIMITS.model_copy(update={"torque": TORQUE}), modes=CONTROL_MODES)
REACH = st.floats(-0.7, 1.7)


def switch(servos: Sequence[int], mode: Mode) -> PlatformSwitch:
    return PlatformSwitch(np.array(servos, dtype=np.intp), mode)


def command(
    mode: Mode, servos: Sequence[int], values: Sequence[float] | Array, speed: float = np.inf
) -> PlatformCommand:
    return PlatformCommand(
        mode, np.array(servos, np.intp), np.array(values, float), np.full(len(servos), speed)
    )


def velocity(servos: Sequence[int], values: Sequence[float] | Array) -> PlatformCommand:
    return command(Mode.VELOCITY, servos, values)


def drive(driven: Driven, order: PlatformCommand, steps: int) -> None:
    for _ in range(steps):
        driven.step(order)


def test_a_velocity_is_reached_and_kept() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2, 3], Mode.VELOCITY))
    drive(driven, velocity([2, 3], [0.5, -0.3]), 200)
    safe = driven.step(velocity([2, 3], [0.5, -0.3]))
    assert safe.modes == (Mode.VELOCITY, Mode.VELOCITY)
    np.testing.assert_allclose(safe.velocity, [0.5, -0.3], atol=1e-9)
    np.testing.assert_allclose((driven.path[-1] - driven.path[-2])[2:4] / PERIOD, [0.5, -0.3], atol=1e-6)
    driven.assert_within_limits()


def test_a_velocity_towards_a_limit_ends_smoothly_at_it() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.VELOCITY))
    drive(driven, velocity([2], [2.5]), 1500)
    assert 2.0 - 1e-3 < driven.angles[2] <= 2.0
    driven.assert_within_limits()
    slowing = np.diff(np.array(driven.path)[:, 2])[400:]
    assert np.all(np.diff(slowing) <= 1e-9)


def test_velocities_that_would_break_a_coupling_slow_down_together() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([0, 1, 2], Mode.VELOCITY))
    drive(driven, velocity([0, 1, 2], [0.6, -0.3, 0.2]), 2000)
    assert driven.angles[0] - driven.angles[1] == pytest.approx(0.8, abs=2e-3)
    assert driven.angles[0] == pytest.approx(-2.0 * driven.angles[1], rel=0.05)
    assert driven.angles[2] == pytest.approx(0.2 * 2000 * PERIOD, rel=0.02)
    driven.assert_within_limits()


def test_a_velocity_beyond_the_limit_is_clamped_and_reported() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.VELOCITY))
    safe = driven.step(velocity([2], [9.0]))
    assert [*map(str, safe.clamped)] == [
        "joint2: 9.00 rad/s (515.66 degrees/s) asked, clamped to 2.70 rad/s (154.70 degrees/s)"
    ]
    drive(driven, velocity([2], [9.0]), 300)
    driven.assert_within_limits()


def test_the_speed_asked_for_beside_the_limit_holds_for_a_velocity() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.VELOCITY))
    order = command(Mode.VELOCITY, [2], [1.0], speed=0.25)
    drive(driven, order, 200)
    assert driven.step(order).velocity[0] == pytest.approx(0.25)


@pytest.mark.parametrize("mode", [Mode.VELOCITY, Mode.TORQUE])
def test_a_command_that_nobody_renews_ends(mode: Mode) -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], mode))
    drive(driven, command(mode, [2], [0.5]), 150)
    timeout = round(driven.gate.settings.command_timeout / PERIOD)
    for _ in range(timeout - 2):
        safe = driven.step()
    assert (safe.velocity if mode is Mode.VELOCITY else safe.torque)[0] == pytest.approx(0.5)
    for _ in range(100):
        safe = driven.step()
    assert np.abs([safe.velocity[0], safe.torque[0]]).max() < 1e-12
    driven.assert_within_limits()


@pytest.mark.parametrize("asked", [0.5, -0.5])
def test_a_joint_that_rests_is_never_pushed_against_what_was_asked(asked: float) -> None:
    """Its encoder repeats to the last bit, as that of a healthy joint at rest may. It got +0.5, then -0.5."""
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.TORQUE))
    steps = [driven.step(command(Mode.TORQUE, [2], [asked])) for _ in range(600)]
    sent = np.array([safe.torque[0] for safe in steps])
    assert ((sent / asked >= 0.0) & (sent / asked <= 1.0)).all()
    assert (sent[10:200] == asked).all()
    assert sent[-1] == 0.0, "a free joint with a frozen encoder would have become too fast"
    told = [str(reason) for safe in steps for reason in safe.clamped]
    assert told == ["joint2: its readings repeat whatever the torque; it gets no more until one differs"]
    driven.angles[2] += 1e-5
    again = [driven.step(command(Mode.TORQUE, [2], [asked])).torque[0] for _ in range(100)]
    assert again[10:] == [asked] * 90


def test_a_velocity_that_nobody_renews_ends_without_a_way_back() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.VELOCITY))
    drive(driven, velocity([2], [0.5]), 150)
    driven.settle()
    assert np.diff(np.array(driven.path)[:, 2]).min() >= -1e-9
    driven.step(velocity([2], [0.5]))
    assert driven.step(velocity([2], [0.5])).velocity[0] > 0.0, "and goes on when asked again"


def test_modes_do_not_change_by_themselves() -> None:
    driven = Driven(ROBOT, ZERO)
    safe = driven.step(velocity([2], [0.5]))
    assert [*map(str, safe.refusals)] == [
        "joint2 is in position mode, the command is in velocity mode; valid: switch the mode first"
    ]
    assert safe.servos.size == 0


def test_a_mode_that_the_robot_lacks_is_refused() -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(switch([2], Mode.TORQUE))
    assert [*map(str, safe.refusals)] == ["tester: joint2 has no torque mode; valid: position"]
    two = Driven(make_robot(modes=(Mode.POSITION, Mode.VELOCITY)), ZERO)
    words = "tester: joint2 has no torque mode; valid: position, velocity"
    assert [*map(str, two.step(switch([2], Mode.TORQUE)).refusals)] == [words]
    assert driven.gate.modes == (Mode.POSITION,) * 6


def test_torque_needs_a_limit_of_torque() -> None:
    robot = make_robot(modes=CONTROL_MODES)
    safe = Driven(robot, ZERO).step(switch([2], Mode.TORQUE))
    assert [*map(str, safe.refusals)] == ["joint2 has no torque mode: its description has no limit of torque"]
    weak = make_robot(limits=LIMITS.model_copy(update={"torque": 0.01}), modes=CONTROL_MODES)
    assert Driven(weak, ZERO).step(switch([2], Mode.TORQUE)).refusals == ()


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (switch([], Mode.TORQUE), "at least one"),
        (switch([9], Mode.TORQUE), "switch: servos [9]; valid: 0 to 5"),
        (switch([1, 1], Mode.TORQUE), "each only once"),
        (switch([1], Mode.STIFFNESS), "switch to stiffness; valid: position, velocity, torque, impedance"),
    ],
)
def test_a_bad_switch_is_refused(order: PlatformSwitch, words: str) -> None:
    assert words in Driven(ROBOT, ZERO).step(order).refusals[0].text


def test_a_servo_that_is_moved_by_hand_waits_for_its_switch() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    moving = JointReading(0.0, 0, read_only(ZERO), read_only([0.0, 0.0, 0.2, 0.0, 0.0, 0.0]))
    safe = gate.step([switch([2], Mode.IMPEDANCE), switch([3], Mode.IMPEDANCE)], moving, 0.0)
    assert [reason.names for reason in safe.clamped] == [("joint2",)]
    assert safe.servos.tolist() == [3]
    safe = gate.step((), reading(ZERO, PERIOD), PERIOD)
    assert safe.servos.tolist() == [2, 3]


@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_a_switch_holds_the_servo_where_it_is(mode: Mode) -> None:
    start = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]
    driven = Driven(ROBOT, start)
    driven.step(position_command([1], [0.25]))
    driven.settle()
    before = driven.angles.copy()
    for _ in range(20):
        safe = driven.step(switch([1, 2], mode))
        assert safe.refusals == ()
    assert set(safe.servos.tolist()) == {1} if mode is Mode.POSITION else {1, 2}
    np.testing.assert_array_equal(driven.angles, before)
    assert np.all(safe.torque == 0.0)


def test_from_impedance_the_servo_goes_on_from_where_it_yielded_to() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.IMPEDANCE))
    driven.step(command(Mode.IMPEDANCE, [2], [0.5]))
    driven.settle()
    driven.angles[2] = 0.47
    safe = driven.gate.step(
        [switch([2], Mode.POSITION)], reading(driven.angles, driven.time + PERIOD), driven.time + PERIOD
    )
    assert safe.modes == (Mode.POSITION,)
    assert safe.position[0] == pytest.approx(0.47)


def test_impedance_moves_its_equilibrium_within_the_limits() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], Mode.IMPEDANCE))
    safe = driven.step(command(Mode.IMPEDANCE, [2], [5.0]))
    assert "joint2: 5.00 rad (286.48 degrees) asked, clamped to 2.00 rad (114.59 degrees)" in str(
        safe.clamped[0]
    )
    driven.settle()
    driven.assert_within_limits()


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.sampled_from([Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE]),
            st.lists(st.integers(0, 5), min_size=1, max_size=6, unique=True),
            st.integers(0, 2**32 - 1),
            st.integers(1, 80),
        ),
        min_size=1,
        max_size=10,
    ),
    st.lists(REACH, min_size=6, max_size=6),
)
def test_hostile_commands_in_mixed_modes(
    orders: list[tuple[Mode, list[int], int, int]], start: list[float]
) -> None:
    start[1] = min(max(start[1], start[0] - 0.75), start[0] + 0.75)
    driven = Driven(ROBOT, start)
    for mode, servos, seed, steps in orders:
        values = np.random.default_rng(seed).uniform(-4.0, 4.0, len(servos))
        driven.step(switch(servos, mode))
        for step in range(steps):
            if mode is Mode.VELOCITY or step == 0:
                driven.step(command(mode, servos, values))
            else:
                driven.step()
    driven.assert_within_limits()


class Loose:
    """One joint with an inertia. The gate's torques and an external torque move it."""

    def __init__(self, *, inertia: float, step: float = PERIOD / 4) -> None:
        self.gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
        self.inertia, self.h = inertia, step
        self.q = self.v = self.time = 0.0
        self.torques: list[float] = [0.0]
        self.fastest = 0.0

    def step(self, *orders: PlatformCommand | PlatformSwitch, outer: float = 0.0) -> GateState:
        position, speed = np.zeros(6), np.zeros(6)
        position[2], speed[2] = self.q, self.v
        joints = JointReading(self.time, round(self.time / PERIOD), read_only(position), read_only(speed))
        safe = self.gate.step(orders, joints, self.time)
        torque = float(safe.torque[safe.servos.tolist().index(2)])
        self.torques.append(torque)
        for _ in range(round(PERIOD / self.h)):
            self.v += (torque + outer) / self.inertia * self.h
            self.q += self.v * self.h
        self.fastest = max(self.fastest, abs(self.v))
        self.time += PERIOD
        return safe.state


@settings(max_examples=25, deadline=None)
@given(
    st.floats(0.035, 0.12),
    st.lists(st.tuples(st.floats(-20.0, 20.0), st.integers(1, 300)), min_size=1, max_size=6),
)
def test_torque_stays_within_limits_of_torque_speed_and_position(
    inertia: float, orders: list[tuple[float, int]]
) -> None:
    """The inertias are such that the torque limit gives the acceleration limit, and that no single period
    covers the whole range between the commanded and the largest speed."""
    loose = Loose(inertia=inertia)
    loose.step(switch([2], Mode.TORQUE))
    for torque, steps in orders:
        for _ in range(steps):
            loose.step(command(Mode.TORQUE, [2], [torque]))
            assert LIMITS.lower <= loose.q <= LIMITS.upper
    assert np.abs(loose.torques).max() <= TORQUE
    assert loose.fastest <= LIMITS.velocity


def test_a_torque_rises_in_time() -> None:
    loose = Loose(inertia=100.0)
    loose.step(switch([2], Mode.TORQUE))
    for _ in range(30):
        loose.step(command(Mode.TORQUE, [2], [5.0]))
    np.testing.assert_allclose(np.diff(loose.torques)[1:11], 5.0 * PERIOD / RISE)
    np.testing.assert_allclose(loose.torques[-1], 5.0, atol=0.05)


def test_a_torque_beyond_the_limit_is_clamped_and_reported() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    gate.step([switch([2], Mode.TORQUE)], reading(ZERO), 0.0)
    safe = gate.step([command(Mode.TORQUE, [2], [-7.0])], reading(ZERO, PERIOD), PERIOD)
    assert [*map(str, safe.clamped)] == ["joint2: -7.00 N m asked, clamped to -5.00 N m"]


def test_at_a_limit_no_torque_leads_outward() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    outside = [0, 0, 2.1, -1.2, 0, 0]
    gate.step([switch([2, 3], Mode.TORQUE)], reading(outside), 0.0)
    for step in range(1, 30):
        now = step * PERIOD
        safe = gate.step([command(Mode.TORQUE, [2, 3], [3.0, -3.0])], reading(outside, now), now)
        assert safe.torque.tolist() == [0.0, 0.0]
    for step in range(30, 60):
        now = step * PERIOD
        safe = gate.step([command(Mode.TORQUE, [2, 3], [-1.0, 1.0])], reading(outside, now), now)
    assert safe.torque.tolist() == [-1.0, 1.0]


def test_a_velocity_that_is_not_measured_lets_go() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    gate.step([switch([2], Mode.TORQUE)], reading(ZERO), 0.0)
    for step in range(1, 30):
        blind = JointReading(step * PERIOD, step, read_only(ZERO), read_only([np.nan] * 6))
        safe = gate.step([command(Mode.TORQUE, [2], [3.0])], blind, step * PERIOD)
    assert safe.torque.tolist() == [0.0]


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.VELOCITY, Mode.TORQUE, Mode.IMPEDANCE])
def test_stop_latches_in_every_mode_until_reset(mode: Mode) -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([2], mode))
    drive(driven, command(mode, [2], [1.0]), 60)
    driven.gate.stop("the operator says so")
    driven.gate.stop("a second reason")
    for _ in range(500):
        safe = driven.step(command(mode, [2], [1.0]))
        assert safe.state is GateState.STOP
        assert [*map(str, safe.refusals)] == ["stop: the operator says so"]
    driven.assert_within_limits()
    assert safe.velocity.tolist() in ([0.0], [])
    assert not safe.torque.any()
    stopped = driven.angles.copy()
    driven.gate.reset()
    assert driven.step().state is GateState.RUN
    np.testing.assert_array_equal(driven.angles, stopped)
    assert driven.gate.counts.stops == 1
    assert driven.step(command(mode, [2], [0.5])).refusals == ()


def test_after_a_stop_that_bent_the_robot_it_goes_on_from_where_it_is() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(position_command([2], [1.0]))
    driven.settle()
    driven.gate.stop("blocked")
    driven.step()
    driven.angles[2] = 0.98
    driven.gate.reset()
    safe = driven.step(position_command([2], [0.5]))
    assert safe.position[0] == pytest.approx(0.98, abs=1e-4)


def test_a_stalled_servo_stops_the_robot() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05, settings=GateSettings(contact=None))
    states = []
    for step in range(600):
        now = step * PERIOD
        safe = gate.step([position_command([2], [1.5])], reading(ZERO, now), now)
        states.append(safe.state)
    assert states[-1] is GateState.STOP
    assert "joint2" in str(safe.reason)
    assert states.index(GateState.STOP) * PERIOD < 0.6


def test_calls_before_their_time_move_nothing_and_late_ones_do_not_catch_up() -> None:
    gate = Gate(ROBOT, period=PERIOD, stale_after=1.0)
    gate.step([position_command([2], [1.5])], reading(ZERO), 0.0)
    times = np.arange(1, 200) * PERIOD
    before = [gate.step([], reading(ZERO, t), t).position[0] for t in times[:20]]
    same = {gate.step([], reading(ZERO, times[19]), times[19]).position[0] for _ in range(5)}
    assert same == {before[-1]}
    late = times[19] + 50 * PERIOD
    one = gate.step([], reading(ZERO, late), late).position[0]
    assert one - before[-1] <= LIMITS.velocity * PERIOD


def test_settings_of_the_timeout_are_checked() -> None:
    with pytest.raises(Exception, match="command_timeout 0"):
        GateSettings(command_timeout=0.0)


def yielded(equilibrium: float, measured: float) -> tuple[Gate, JointReading]:
    """Returns a gate with servo 2 in impedance mode, held away from its equilibrium, and servo 3 in position
    mode."""
    driven = Driven(ROBOT, ZERO)
    watch = MonitorSettings(encoder_step=1.0)  # an external force moves the joint between two readings
    driven.gate = Gate(ROBOT, period=PERIOD, stale_after=0.05, settings=GateSettings(monitor=watch))
    driven.step(switch([2], Mode.IMPEDANCE), position_command([3], [0.2]))
    driven.step(command(Mode.IMPEDANCE, [2], [equilibrium]))
    driven.settle()
    angles = driven.angles.copy()
    angles[2] = measured
    return driven.gate, reading(angles, driven.time + PERIOD)


def stiffen(
    gate: Gate, joints: JointReading, servos: Sequence[int], shares: Sequence[float]
) -> tuple[str, ...]:
    """Returns the texts of the refusals of a change of stiffness."""
    gate.check_out(safe := gate.step([command(Mode.STIFFNESS, servos, shares)], joints, joints.stamp))
    return tuple(map(str, safe.refusals))


def test_a_joint_that_yielded_is_not_thrown_back() -> None:
    gate, joints = yielded(0.5, 0.3)
    words = "joint2 is 11.5 degrees from its equilibrium; valid: no more stiffness than 0.00 there"
    assert stiffen(gate, joints, [2], [0.5]) == (words,)
    assert stiffen(gate, joints, [3, 2], [0.5, 0.5]) == (words,)
    assert stiffen(gate, joints, [3], [0.5]) == ()  # not in impedance mode
    assert stiffen(gate, joints, [2], [-0.5]) == ()
    assert stiffen(gate, joints, [2], [0.1]) == (words,)


def test_near_its_equilibrium_it_may_be_as_stiff_as_it_likes_and_elsewhere_no_stiffer_than_it_is() -> None:
    gate, joints = yielded(0.5, 0.45)
    assert stiffen(gate, joints, [2], [1.7]) == ()
    gate, joints = yielded(0.5, 0.5)
    assert stiffen(gate, joints, [2], [1.7]) == ()
    angles = np.array(joints.position)
    angles[2] = 0.3
    away = reading(angles, joints.stamp + PERIOD)
    assert "valid: no more stiffness than 1.00 there" in stiffen(gate, away, [2], [1.5])[0]
    assert stiffen(gate, away, [2], [1.0]) == ()
    assert stiffen(gate, away, [2], [0.4]) == ()
    assert "valid: no more stiffness than 0.40 there" in stiffen(gate, away, [2], [1.0])[0]


def test_without_a_watch_nobody_looks_where_the_equilibrium_is() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.gate = Gate(ROBOT, period=PERIOD, stale_after=0.05, settings=GateSettings(monitor=None))
    driven.step(switch([2], Mode.IMPEDANCE))
    driven.step(command(Mode.IMPEDANCE, [2], [0.5]))
    driven.settle()
    assert stiffen(driven.gate, reading(ZERO, driven.time), [2], [0.9]) == ()


def test_a_servo_that_is_not_under_command_may_be_as_stiff_as_it_likes() -> None:
    gate = Gate(make_robot(modes=(Mode.IMPEDANCE,)), period=PERIOD, stale_after=0.05)
    assert stiffen(gate, reading(ZERO), [2], [0.9]) == ()


def test_targets_for_servos_under_command_change_no_group() -> None:
    groups = CommandedGroups(ROBOT, period=PERIOD, settings=GateSettings())
    groups.moving([2, 3])
    before = groups.chains
    groups.moving([3])
    assert groups.chains is before


def test_a_command_a_little_beyond_a_limit_is_clamped_and_reported() -> None:
    driven = Driven(ROBOT, ZERO)
    assert not driven.step(position_command([2], [2.0 + 0.5 * MARGIN])).clamped
    assert driven.step(position_command([2], [2.0 + 1.5 * MARGIN])).clamped


def test_a_servo_that_was_driven_goes_to_targets_again() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(switch([1, 2], Mode.VELOCITY))
    drive(driven, velocity([1, 2], [0.1, 0.5]), 100)
    driven.settle()
    driven.step(switch([2], Mode.POSITION))
    driven.step(position_command([2], [0.9]))
    driven.settle()
    assert driven.angles[2] == pytest.approx(0.9, abs=1e-6)
    assert driven.gate.modes[1:3] == (Mode.VELOCITY, Mode.POSITION)


def test_a_servo_in_torque_mode_is_told_once() -> None:
    driven = Driven(ROBOT, ZERO)
    driven.step(position_command([2], [0.1]))
    driven.settle()
    assert driven.step(switch([2], Mode.TORQUE)).servos.tolist() == [2]
    assert driven.step(command(Mode.TORQUE, [2], [0.5])).modes == (Mode.TORQUE,)


def test_a_speed_is_estimated_from_new_stamps_only() -> None:
    def at(stamp: float, angle: float, measured: float = np.nan) -> JointReading:
        return JointReading(stamp, 0, read_only([angle, 0.0]), read_only([measured, 0.5]))

    speeds = Speeds(2)
    assert speeds.step(at(1.0, 0.3)).tolist() == [0.0, 0.5]
    for stamp, angle in ((1.0, 0.4), (0.9, 0.5)):
        assert speeds.step(at(stamp, angle)).tolist() == [0.0, 0.5]
    assert speeds.step(at(0.9 + SMOOTHING, 0.5 + SMOOTHING)) == pytest.approx([0.5, 0.5])
    assert speeds.step(at(0.9 + 2 * SMOOTHING, 0.5 + 2 * SMOOTHING)) == pytest.approx([0.75, 0.5])
    assert speeds.step(at(1.1, 0.0, 0.2)).tolist() == [0.2, 0.5]
