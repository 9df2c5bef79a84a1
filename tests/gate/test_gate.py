"""The gate passes no command that violates a limit, and only the gate can create the commands that a driver
writes."""

from __future__ import annotations

import dataclasses
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.gate_checks import (
    LIMITS,
    PERIOD,
    Driven,
    make_robot,
    position_command,
    reading,
)
from tci.errors import CommandError, DriverError, TciError
from tci.gate.acceptance import SLOWEST, is_likely_degrees
from tci.gate.gate import Gate, GateSettings, GateState, SafeCommand
from tci.messages import GenericCommand, Mode, PlatformCommand, PlatformSwitch
from tci.reasons import Code
from tci.robot.description import Limits, Robot

ZERO = [0.0] * 6
WILD = st.one_of(st.floats(-4.0, 4.0), st.sampled_from([np.nan, np.inf, -np.inf, 1e300, -1e9]), st.just(0.0))


def test_without_commands_nothing_is_sent() -> None:
    assert Driven(make_robot(), ZERO).step().servos.size == 0


def test_a_target_is_reached_and_other_joints_are_never_sent() -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(position_command([2, 4], [0.5, -0.3]))
    assert set(safe.servos) == {2, 4}
    driven.settle()
    np.testing.assert_allclose(driven.angles, [0, 0, 0.5, 0, -0.3, 0], atol=1e-6)
    driven.assert_within_limits()


def test_the_first_step_continues_where_the_robot_was_measured() -> None:
    driven = Driven(make_robot(), [0.3, 0.2, -0.5, 1.0, 0.0, 0.0])
    safe = driven.step(position_command([2], [1.0]))
    assert abs(safe.position[0] - -0.5) < LIMITS.jerk * PERIOD**3


ANGLES = pytest.mark.parametrize("mode", [Mode.POSITION, Mode.IMPEDANCE])


@ANGLES
def test_a_command_to_servos_that_move_already_is_refused_for_the_same_faults(mode: Mode) -> None:
    driven = Driven(make_robot(modes=(mode,)), ZERO)
    good = dataclasses.replace(position_command([2, 3], [0.5, 0.5]), mode=mode)
    for _ in range(3):
        driven.step(good)
    targets = driven.gate.targets
    for values, speed, code in (
        ([0.1, np.nan], 1.0, Code.COMMAND_INVALID),
        ([0.1, 0.2], 0.5 * SLOWEST, Code.COMMAND_INVALID),
        ([45.0, 90.0], 1.0, Code.LIKELY_DEGREES),
        ([7.0, 0.2], 1.0, Code.LIKELY_DEGREES),
    ):
        wrong = position_command([2, 3], values, speed)
        assert driven.step(dataclasses.replace(wrong, mode=mode)).refusals[0].code is code
        assert np.array_equal(driven.gate.targets, targets)


def test_a_command_of_other_number_types_counts_like_one_of_doubles() -> None:
    paths = []
    for servos, values in (([2, 4], np.float64), (np.array([2, 4], np.int16), np.float32)):
        driven, command = Driven(make_robot(), ZERO), position_command([2, 4], [0.5, -0.25])
        command = dataclasses.replace(command, servos=np.array(servos), values=command.values.astype(values))
        for _ in range(5):
            driven.step(command)
        paths.append(np.array(driven.path))
    assert np.array_equal(*paths)
    assert paths[0].any()


@pytest.mark.parametrize("name", ["position", "velocity"])
def test_joint_data_that_are_no_doubles_are_an_error(name: str) -> None:
    """Compiled loops would read the bytes of other numbers as doubles."""
    gate, joints = Gate(make_robot(), period=PERIOD, stale_after=0.05), reading(ZERO)
    wrong = dataclasses.replace(joints, **{name: np.zeros(6, np.int64)})
    types = {"position": "float64", "velocity": "float64", name: "int64"}
    words = f"joint angles of type {types['position']}, velocities of {types['velocity']}; valid: float64"
    with pytest.raises(TypeError, match=words):
        gate.step((), wrong, 0.0)


@ANGLES
def test_position_is_clamped_reported_and_what_is_sent_is_the_clamped_value(mode: Mode) -> None:
    driven = Driven(make_robot(modes=(mode,)), ZERO)
    safe = driven.step(dataclasses.replace(position_command([3], [6.0]), mode=mode))
    assert (safe.clamped[0].code, safe.clamped[0].names) == (Code.CLAMPED, ("joint3",))
    assert "114.59" in str(safe.clamped[0])
    driven.settle()
    assert 2.0 - 1e-5 < driven.angles[3] <= 2.0
    assert driven.gate.counts.clamps == {"joint3": 1}


def test_couplings_are_kept_on_the_way_and_at_the_end() -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(position_command([0, 1], [1.5, -0.5]))
    assert safe.clamped
    driven.settle()
    assert driven.angles[0] - driven.angles[1] == pytest.approx(0.8, abs=1e-4)
    driven.assert_within_limits()


def test_a_coupled_servo_that_nobody_commands_counts_where_it_is() -> None:
    driven = Driven(make_robot(), [0.0, 0.5, 0, 0, 0, 0])
    driven.step(position_command([0], [2.0]))
    driven.settle()
    assert driven.angles[0] == pytest.approx(1.3, abs=1e-4)
    driven.assert_within_limits()


def test_a_servo_joins_beside_a_coupled_one_that_nobody_commands() -> None:
    """The gate uses the measured position of the other servo from the start. An earlier version used 0 and
    refused the command."""
    driven = Driven(make_robot(), [0.5, 1.0, 0, 0, 0, 0])
    driven.step(position_command([0], [1.7]))
    for _ in range(60):
        driven.step()
    assert driven.angles[0] > 0.55
    assert not driven.step(position_command([3], [-0.9])).refusals
    driven.settle()
    assert driven.angles[[0, 3]] == pytest.approx([1.7, -0.9], abs=1e-6)
    driven.assert_within_limits()


def test_joints_join_a_motion_without_a_jump() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([2], [1.5]))
    for _ in range(50):
        driven.step()
    driven.step(position_command([3], [-0.9]))
    driven.settle()
    np.testing.assert_allclose(driven.angles[2:4], [1.5, -0.9], atol=1e-6)
    driven.assert_within_limits()


@ANGLES
def test_start_outside_the_limits_moves_inward_only_and_slowly(mode: Mode) -> None:
    driven = Driven(make_robot(modes=(mode,)), [0, 0, 2.3, 0, 0, 0])
    driven.step(dataclasses.replace(position_command([2], [2.2]), mode=mode))
    driven.settle()
    path = np.array(driven.path)[:, 2]
    assert np.all(np.diff(path) <= 1e-12)
    outside = path[1:] > 2.0
    assert np.abs(np.diff(path) / PERIOD)[outside].max() <= 0.11 * 3.0
    assert driven.angles[2] <= 2.0


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.IMPEDANCE, Mode.VELOCITY])
def test_a_joint_outside_its_limits_comes_in_though_nobody_says_where_to(mode: Mode) -> None:
    """In an earlier version such a joint was held at its position until a command named it."""
    driven = Driven(make_robot(modes=(Mode.TORQUE, mode)), [0, 0, 2.3, 0, 0, 0])
    driven.step(PlatformSwitch(np.array([2]), mode))
    for _ in range(60):
        driven.step()
    driven.gate.hold("a pause")
    driven.settle()
    assert driven.angles[2] > 2.0, "it rests while the robot holds"
    driven.step(PlatformSwitch(np.array([3]), mode))
    driven.settle()
    path = np.array(driven.path)[:, 2]
    assert 1.9 < path[-1] <= 2.0
    assert np.abs(np.diff(path)).max() / PERIOD <= 0.11 * 3.0
    driven.assert_within_limits()


def test_a_joint_that_a_touch_pressed_outside_comes_no_farther_in_than_its_limit() -> None:
    """In an earlier version the joint returned at a tenth of its speed limit and moved farther inside,
    against the finger that had pressed it."""
    driven = Driven(make_robot(modes=(Mode.TORQUE, Mode.VELOCITY)), [0, 0, 2.0002, 0, 0, 0])
    driven.step(PlatformSwitch(np.array([2]), Mode.VELOCITY))
    driven.settle()
    assert 2.0 - 1e-5 < np.array(driven.path)[:, 2].min() <= 2.0


def test_a_joint_outside_its_limits_comes_in_slowly_beside_one_in_velocity_mode() -> None:
    """In an earlier version the target velocity exceeded the speed of the command. The library ruckig refuses
    this, so no joint moved."""
    driven = Driven(make_robot(modes=(Mode.POSITION, Mode.VELOCITY)), [0, 0, 2.3, 0, 0, 0])
    driven.step(position_command([2], [1.5], speed=0.5))
    driven.step(PlatformSwitch(np.array([3]), Mode.VELOCITY))
    velocity = dataclasses.replace(position_command([3], [0.2]), mode=Mode.VELOCITY)
    for _ in range(100):
        driven.step(velocity)
    assert driven.angles[2] < 2.29
    assert driven.angles[3] > 0.01
    outside = np.array(driven.path)[:, 2]
    assert np.abs(np.diff(outside)).max() / PERIOD <= 0.11 * 0.5


@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.VELOCITY])
def test_a_joint_that_sags_does_not_wander_outside_however_often_it_starts_anew(mode: Mode) -> None:
    """In an earlier version a G1's shoulder moved outwards by its sag at each start: the reference began at
    the sagged position and stayed there."""
    sag, farthest = 0.005, -np.inf
    driven = Driven(make_robot(modes=(Mode.IMPEDANCE, mode)), [0, 0, 2.0, 0, 0, 0])
    for turn in range(12):
        driven.gate.drop()
        driven.step(PlatformSwitch(np.array([2]), (mode, Mode.IMPEDANCE)[turn % 2]))
        for _ in range(50):
            farthest = max(farthest, driven.step().position[0])
            driven.angles[2] += sag
    assert 2.0 < farthest <= 2.0 + sag + 1e-9


def test_speed_of_the_description_holds_beside_the_limit() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([2], [1.5], speed=0.5))
    driven.settle()
    assert np.abs(np.diff(np.array(driven.path)[:, 2])).max() / PERIOD <= 0.5 + 1e-9


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (position_command([2], [np.nan]), "joint2 is nan"),
        (position_command([2], [np.inf]), "finite"),
        (position_command([2, 2], [0.1, 0.2]), "each only once"),
        (position_command([17], [0.1]), "0 to 5"),
        (position_command([-1], [0.1]), "0 to 5"),
        (position_command([], []), "at least one"),
        (position_command([2], [0.1], speed=0.0), "speed of joint2 is 0.0; valid: at least 0.001 rad/s"),
        (position_command([2], [0.1], speed=1e-300), "speed of joint2"),
        (position_command([2], [0.1], speed=np.nan), "speed of joint2 is nan"),
        (PlatformCommand(Mode.POSITION, np.arange(3), np.zeros(2), np.ones(3)), "as many values"),
        (PlatformCommand(Mode.POSITION, np.array([0.5]), np.zeros(1), np.ones(1)), "0 to 5"),
        (PlatformCommand(Mode.TORQUE, np.arange(1), np.zeros(1), np.ones(1)), "torque"),
    ],
)
def test_a_bad_command_is_refused_whole_with_a_message(command: PlatformCommand, words: str) -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([3], [0.5]))
    safe = driven.step(command)
    assert words in safe.refusals[0].text
    assert driven.gate.counts.refusals == 1
    driven.settle()
    np.testing.assert_allclose(driven.angles, [0, 0, 0, 0.5, 0, 0], atol=1e-6)


@pytest.mark.parametrize(
    ("servos", "values", "speeds", "told"),
    [
        ([0, 1, 2], [0.0, 0.0], [1.0, 1.0, 1.0],
         "position: (3,) servos and (2,) values; valid: as many values as servos, at least one"),
        ([0, 1, 2], [0.0, 0.0, 0.0], [1.0], "position: (1,) speeds; valid: one for each of 3 servos"),
        ([4, 6], [0.0, 0.0], [1.0, 1.0], "position: servos [4, 6]; valid: 0 to 5"),
        ([2, 2], [0.0, 0.0], [1.0, 1.0], "position: servos [2, 2]; valid: each only once"),
        ([2], [1j], [1.0], "position: values of type complex128; valid: real numbers"),
        ([2], [0.1], [True], "position: speeds of type bool; valid: real numbers"),
        ([2, 3, 4], [np.nan, 0.0, np.inf], [1.0, 1.0, 1.0],
         "position of joint2 is nan, joint4 is inf; valid: finite numbers"),
        ([2, 3, 4], [0.0, 0.0, 0.0], [0.0, np.nan, 1.0],
         "speed of joint2 is 0.0, joint3 is nan; valid: at least 0.001 rad/s"),
    ],
)  # fmt: skip
def test_a_refusal_names_what_is_wrong_and_what_would_be_valid(
    servos: list[int], values: list[float], speeds: list[float], told: str
) -> None:
    command = PlatformCommand(Mode.POSITION, np.array(servos), np.array(values), np.array(speeds))
    assert [*map(str, Driven(make_robot(), ZERO).step(command).refusals)] == [told]


def test_numbers_of_other_types_are_taken_for_what_they_are() -> None:
    driven = Driven(make_robot(), ZERO)
    servos = np.array([2, 3], np.int32)
    slow = PlatformCommand(Mode.POSITION, servos, np.array([1, 0]), np.full(2, SLOWEST))
    fast = PlatformCommand(Mode.POSITION, servos, np.array([1, 0]), np.full(2, 1.0, np.float32))
    assert driven.step(slow).refusals == driven.step(fast).refusals == ()
    driven.settle()
    np.testing.assert_allclose(driven.angles[2:4], [1.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("missing", ["lower", "upper", "velocity", "acceleration", "jerk"])
def test_a_servo_without_a_limit_is_not_moved(missing: str) -> None:
    driven = Driven(make_robot(limits=LIMITS.model_copy(update={missing: None})), ZERO)
    safe = driven.step(position_command([2], [0.5]))
    assert f"joint2 can't be moved: its description has no limit of {missing}" in safe.refusals[0].text
    assert safe.servos.size == 0


def test_a_command_for_a_whole_part_leaves_a_servo_that_can_not_be_moved_where_it_is() -> None:
    """Programs for control boards send such commands for whole parts. A command only for this servo is
    refused."""
    whole = make_robot(coupled=False)
    fixed = whole.servos[3].model_copy(update={"limits": Limits()})
    robot = whole.model_copy(update={"servos": (*whole.servos[:3], fixed, *whole.servos[4:])})
    driven = Driven(robot, ZERO)
    safe = driven.step(position_command(range(6), [0.2] * 6))
    assert safe.refusals == ()
    driven.settle()
    np.testing.assert_allclose(driven.angles, [0.2, 0.2, 0.2, 0.0, 0.2, 0.2], atol=1e-6)
    driven.assert_within_limits()
    for servos in ([3], [2, 3]):
        safe = driven.step(position_command(servos, [0.1] * len(servos)))
        assert "joint3 can't be moved" in safe.refusals[0].text
    assert driven.step(PlatformSwitch(np.arange(6), Mode.POSITION)).refusals == ()
    safe = driven.step(PlatformCommand(Mode.POSITION, np.arange(6), np.zeros(6), np.ones(5)))
    assert "(5,) speeds" in safe.refusals[0].text


def test_a_command_in_generic_joints_is_refused_whole() -> None:
    safe = Driven(make_robot(), ZERO).step(GenericCommand("head", Mode.POSITION, np.zeros(3)))
    assert "a GenericCommand is not in the robot's own joints" in safe.refusals[0].text
    assert safe.servos.size == 0


def test_stiffness_and_damping_are_clamped_to_a_share() -> None:
    driven = Driven(make_robot(), ZERO)
    for mode, name in ((Mode.STIFFNESS, "stiffness"), (Mode.DAMPING, "damping")):
        safe = driven.step(PlatformCommand(mode, np.array([0, 1]), np.array([0.4, 1.7]), np.ones(2)))
        assert getattr(safe, name) == {0: 0.4, 1: 1.0}
        assert name in str(safe.clamped[0])


def test_old_joint_data_means_hold_and_clears_by_itself_without_replay() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([2], [1.5]))
    for _ in range(60):
        driven.step()
    frozen = reading(driven.angles, driven.time - 0.2)
    for _ in range(400):
        driven.time += PERIOD
        safe = driven.gate.step([position_command([2], [-1.0])], frozen, driven.time)
        assert safe.state is GateState.HOLD
        assert "old" in safe.refusals[0].text
        assert safe.orders == ()
        driven.angles[safe.servos] = safe.position
        driven.path.append(driven.angles.copy())
    driven.assert_within_limits()
    stopped = driven.angles[2]
    assert driven.path[-1][2] == driven.path[-50][2]
    assert driven.step().state is GateState.RUN
    driven.settle()
    assert driven.angles[2] == stopped
    assert driven.gate.counts.holds == 1
    again = position_command([2], [0.2])
    assert driven.step(again).orders == (again,)
    assert driven.step().orders == ()
    driven.settle()
    assert driven.angles[2] == pytest.approx(0.2, abs=1e-6)


def test_after_a_short_hold_a_command_to_one_joint_does_not_send_others_on() -> None:
    """The old targets are dropped when the hold begins, not when the robot has come to rest."""
    for partner in (2, 3):  # a joint that is already commanded, and a joint that is added
        driven = Driven(make_robot(), ZERO)
        driven.step(position_command([2, 4], [1.5, 1.5]))
        for _ in range(60):
            driven.step()
        driven.gate.step([], reading(driven.angles, driven.time - 0.2), driven.time)
        driven.step(position_command([partner], [0.1]))
        driven.settle()
        assert 0.0 < driven.angles[4] < 1.0
        assert driven.angles[partner] == pytest.approx(0.1, abs=1e-6)


def test_a_slower_speed_in_full_motion_never_stops_the_loop() -> None:
    """From some states ruckig finds no synchronised trajectory. Then the gate executes the stop that it has
    checked before."""
    random = np.random.default_rng(1)
    driven = Driven(make_robot(), random.uniform(-0.5, 0.5, 6).tolist())
    for _ in range(300):
        servos = random.permutation(6)[: random.integers(1, 7)]
        speed = float(random.choice([0.01, 0.1, 1.0, np.inf]))
        driven.step(position_command(servos.tolist(), random.uniform(-1.5, 2.5, servos.size).tolist(), speed))
        for _ in range(random.integers(1, 40)):
            driven.step()
    driven.assert_within_limits()


def test_a_clamped_coupling_moves_no_servo_that_was_not_named() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([0, 1], [0.2, 0.1]))
    driven.settle()
    driven.step(position_command([0], [2.0]))
    driven.settle()
    assert driven.angles[1] == pytest.approx(0.1, abs=1e-6)
    assert driven.angles[0] == pytest.approx(0.9, abs=1e-4)


def test_a_coupled_servo_that_is_moved_by_hand_counts_where_it_is_now() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([0], [0.75]))
    driven.settle()
    for _ in range(50):
        driven.step()
    for _ in range(100):
        driven.angles[1] += 0.006
        driven.step()
    driven.step(position_command([0], [2.0]))
    driven.settle()
    assert driven.angles[0] == pytest.approx(1.4, abs=1e-4)


@pytest.mark.parametrize(
    "bad",
    [reading([0.0] * 5), reading([0, 0, np.nan, 0, 0, 0]), reading(ZERO, np.nan), reading(ZERO, 1e6)],
    ids=["length", "nan", "stamp", "future"],
)
def test_unusable_joint_data_means_hold(bad: object) -> None:
    gate = Gate(make_robot(), period=PERIOD, stale_after=0.05)
    assert gate.step([], bad, 0.0).state is GateState.HOLD


def test_only_the_gate_makes_what_its_link_writes_and_only_once() -> None:
    gate, other = (Gate(make_robot(), period=PERIOD, stale_after=0.05) for _ in range(2))
    safe = gate.step([position_command([2], [0.5])], reading(ZERO), 0.0)
    with pytest.raises(DriverError):
        other.check_out(safe)
    with pytest.raises(DriverError):
        gate.check_out(dataclasses.replace(safe, position=np.array([9.0])))
    gate.check_out(safe)
    with pytest.raises(DriverError):
        gate.check_out(safe)
    fields = {field.name: getattr(safe, field.name) for field in dataclasses.fields(safe)}
    with pytest.raises(DriverError, match="only a gate"):
        SafeCommand(**{**fields, "seal": object()})
    with pytest.raises(ValueError, match="read-only"):
        safe.position[0] = 9.0


def test_a_command_that_was_overtaken_is_not_written() -> None:
    gate = Gate(make_robot(), period=PERIOD, stale_after=0.05)
    old = gate.step([], reading(ZERO), 0.0)
    gate.step([], reading(ZERO), 0.0)
    with pytest.raises(DriverError):
        gate.check_out(old)


@pytest.mark.parametrize("value", [0.0, -0.1, 1.1, np.nan])
def test_settings_are_checked(value: float) -> None:
    with pytest.raises(TciError):
        GateSettings(speed_share=value)
    if not 0.0 < value < 2.0:
        with pytest.raises(TciError):
            Gate(make_robot(), period=value, stale_after=0.05)


def test_same_inputs_same_bits() -> None:
    runs = []
    for _ in range(2):
        driven = Driven(make_robot(), ZERO)
        driven.step(position_command([0, 1, 2], [0.5, 0.2, 1.0]))
        driven.settle()
        runs.append(np.array(driven.path))
    assert np.array_equal(*runs)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 5), WILD, st.integers(1, 60)), min_size=1, max_size=12))
def test_hostile_commands_one_joint(orders: list[tuple[int, float, int]]) -> None:
    driven = Driven(make_robot(), ZERO)
    for servo, value, steps in orders:
        driven.step(position_command([servo], [value]))
        for _ in range(steps):
            driven.step()
    driven.assert_within_limits()


def test_hostile_commands_many() -> None:
    """Random targets, often changed during full motion, some of them malformed. `make soak` runs more
    steps."""
    cycles = int(os.environ.get("TCI_SOAK", "6000"))
    random = np.random.default_rng(7)
    driven = Driven(make_robot(), ZERO)
    for cycle in range(cycles):
        commands = []
        if random.random() < 0.05:
            values = random.uniform(-3.0, 3.0, 6)
            if random.random() < 0.3:
                values[random.integers(6)] = random.choice([np.nan, np.inf, -1e12])
            commands.append(position_command(range(6), values, speed=random.choice([0.5, 2.0, np.inf])))
        driven.step(*commands)
        if cycle % 5000 == 4999:
            driven.assert_within_limits()
            del driven.path[:-3]
    driven.assert_within_limits()
    assert driven.gate.counts.refusals > 0


def test_unlimited_robot_is_refused_before_anything_moves() -> None:
    driven = Driven(make_robot(limits=Limits()), ZERO)
    assert driven.step(position_command([0], [0.1])).servos.size == 0


def test_speeds_that_do_not_fit_the_servos_are_refused() -> None:
    driven = Driven(make_robot(), ZERO)
    command = dataclasses.replace(position_command([2, 4], [0.5, -0.3]), speed=np.ones(3))
    safe = driven.step(command)
    assert safe.servos.size == 0
    assert "speeds; valid: one for each of 2 servos" in safe.refusals[0].text


def test_targets_are_where_the_servos_go_whatever_was_asked_for() -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(position_command([2, 3], [0.5, 6.0]))
    going = dict(zip(safe.servos.tolist(), driven.gate.targets.tolist(), strict=True))
    assert going[2] == pytest.approx(0.5)
    assert 2.0 - 1e-5 < going[3] <= 2.0
    driven.gate.stop("now")
    safe = driven.step()
    assert np.abs(driven.gate.targets).max() < 0.01, "where it comes to rest"


def test_a_gate_without_a_watch_forgets_its_servos_too() -> None:
    gate = Gate(make_robot(), period=PERIOD, stale_after=0.1, settings=GateSettings(monitor=None))
    safe = gate.step([position_command([2], [0.5])], reading(ZERO, 0.0), 0.0)
    assert safe.servos.tolist() == [2]
    gate.drop()
    assert gate.targets.size == 0
    assert gate.step([], reading(ZERO, PERIOD), PERIOD).servos.size == 0
    gate.stop("the watch")
    assert gate.step([], reading(ZERO, 2 * PERIOD), 2 * PERIOD).state is GateState.STOP
    gate.reset()
    assert gate.step([], reading(ZERO, 3 * PERIOD), 3 * PERIOD).state is GateState.RUN


def test_stops_are_counted_and_have_a_reason() -> None:
    driven = Driven(make_robot(), ZERO)
    for count, (said, told) in enumerate([("it smokes", "it smokes"), ("", "stopped without a reason")]):
        driven.gate.stop(said)
        driven.gate.stop("another one")
        assert str(driven.step().reason) == told
        assert driven.gate.counts.stops == count + 1
        driven.gate.reset()
        assert driven.step().state is GateState.RUN


def test_a_robot_that_moves_is_not_reset() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([2], [1.5]))
    for _ in range(50):
        driven.step()
    driven.gate.stop("it smokes")
    with pytest.raises(CommandError, match=r"^the robot still moves; valid: reset at rest, after a stop$"):
        driven.gate.reset()
    assert str(driven.step().reason) == "it smokes"


def test_less_than_no_stiffness_is_none() -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(PlatformCommand(Mode.DAMPING, np.array([0, 1]), np.array([-0.4, 0.7]), np.ones(2)))
    assert safe.damping == {0: 0.0, 1: 0.7}
    assert [*map(str, safe.clamped)] == ["joint0: -0.40 damping asked, clamped to 0.00 damping"]


def test_what_lies_ahead_is_where_the_robot_then_is() -> None:
    driven = Driven(make_robot(), ZERO)
    driven.step(position_command([2, 3], [0.5, -0.4]))
    for _ in range(20):
        safe = driven.step()
    ahead = driven.gate.ahead(0.1)
    assert driven.gate.ahead(1e3) == pytest.approx(driven.gate.targets)
    with pytest.raises(TypeError):
        driven.gate.ahead(np.zeros((2, 2)))
    for _ in range(50):
        driven.step()
    assert driven.angles[safe.servos] == pytest.approx(ahead, abs=1e-9)


def called_at(times: list[float], caplog: pytest.LogCaptureFixture) -> list[str]:
    """Returns the log of a gate that is called at these times [s], with new joint readings and no command."""
    gate = Gate(make_robot(), period=PERIOD, stale_after=10.0)
    for now in times:
        gate.step((), reading(ZERO, now), now)
    said = [record.getMessage() for record in caplog.records if record.name == "tci"]
    caplog.clear()
    return said


def test_a_loop_at_a_rate_of_its_own_is_told_at_its_second_late_call(
    caplog: pytest.LogCaptureFixture,
) -> None:
    late = [0.0, 0.02, 0.0401]
    assert not called_at(late[:2], caplog)
    (said,) = called_at(late, caplog)
    assert "called every 20.1 ms and plans for 2 ms: motions take 10 times as long; valid: " in said
    assert "a step in each of driver.ticks(), or connect to 'sim' with rate=49.75" in said
    assert said.endswith("other drivers have the rate of their binding in the robot's description")
    assert len(called_at([0.02 * number for number in range(100)], caplog)) == 1
    assert len(called_at([0.004 * number for number in range(3)], caplog)) == 1


@pytest.mark.parametrize(
    "times",
    [
        [PERIOD * number for number in range(50)],
        [1.04 * PERIOD * number for number in range(50)],
        [0.1 * PERIOD * number for number in range(50)],
        [0.0, 0.02, 0.022, 0.042, 0.044],
        [0.0, 0.02, 0.05, 0.06, 0.1],
        [0.0, 0.002, *(0.02 * number for number in range(1, 50))],
        [0.0, 0.02, -1.0, -0.98],
    ],
    ids=["in time", "a little slow", "quick", "now and then", "busy machine", "delayed", "time goes back"],
)
def test_a_loop_at_the_gates_rate_is_told_nothing(
    times: list[float], caplog: pytest.LogCaptureFixture
) -> None:
    assert not called_at(times, caplog)


@pytest.mark.parametrize("values", [[30.0, 0.0], [-6.5, 0.0], [5.0, -5.0], [3.2, 3.2]])
def test_angles_that_look_like_degrees_are_refused_whole(values: list[float]) -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(position_command([2, 3], values))
    assert "degrees? valid: radians" in safe.refusals[0].text
    assert not safe.servos.size
    assert not driven.gate.counts.clamps


def test_one_wrong_angle_of_three_is_refused_and_not_called_degrees() -> None:
    safe = Driven(make_robot(), ZERO).step(position_command([2, 3, 4], [0.1, 0.2, 7.0]))
    (refusal,) = safe.refusals
    assert (refusal.code, safe.servos.size) == (Code.LIMITS_EXCEEDED, 0)
    assert "joint4 at 7 rad is more than a full turn; valid: -1.00 .. 2.00 rad" in refusal.text


@pytest.mark.parametrize(
    ("values", "likely"),
    [
        ([7.0, 0.1, 0.1, 0.1], False),
        ([7.0, -7.0, 0.1, 0.1, 0.1], True),
        ([7.0, 0.1], True),
        ([6.2, 6.2], False),
        ([0.0, 0.0], False),
    ],
)
def test_two_angles_beyond_a_turn_or_half_of_them_are_likely_degrees(
    values: list[float], likely: bool
) -> None:
    assert is_likely_degrees(np.array(values)) is likely
    assert not is_likely_degrees(np.array(values), np.zeros(len(values), np.bool_))


def with_wide_limits(*wide: int) -> Robot:
    """Returns the robot of these tests. Some of its servos turn by 20 rad to both sides."""
    robot = make_robot()
    free = LIMITS.model_copy(update={"lower": -20.0, "upper": 20.0})
    servos = tuple(
        servo.model_copy(update={"limits": free}) if servo.index in wide else servo for servo in robot.servos
    )
    return robot.model_copy(update={"servos": servos})


def test_a_wrong_angle_beside_larger_angles_inside_wide_limits_is_named() -> None:
    """In an earlier version the message named the joint with the largest angle, which is valid."""
    driven = Driven(with_wide_limits(2), ZERO)
    (refusal,) = driven.step(position_command([2, 3, 4], [15.0, 7.0, 0.1])).refusals
    assert refusal.code == Code.LIMITS_EXCEEDED
    assert "joint3 at 7 rad is more than a full turn; valid: -1.00 .. 2.00 rad" in refusal.text


def test_angles_inside_wide_limits_are_no_sign_of_degrees() -> None:
    """In an earlier version two valid angles beyond a full turn made one wrong angle a wrong unit."""
    driven = Driven(with_wide_limits(2, 3), ZERO)
    (refusal,) = driven.step(position_command([2, 3, 4, 5], [15.0, 9.0, 7.0, 0.1])).refusals
    assert refusal.code == Code.LIMITS_EXCEEDED
    assert "joint4 at 7 rad is more than a full turn" in refusal.text
    assert not driven.step(position_command([2, 3], [15.0, 9.0])).refusals


@pytest.mark.parametrize("values", [[6.2], [-6.2], [5.0, 2.9], [2.9, 2.9], [0.1, 6.2]])
def test_angles_that_are_only_too_far_are_clamped(values: list[float]) -> None:
    driven = Driven(make_robot(), ZERO)
    safe = driven.step(position_command([2, 3][: len(values)], values))
    assert not safe.refusals
    assert safe.clamped
