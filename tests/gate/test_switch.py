"""Changes of mode while servos move: in motion where set-points are streamed, at rest elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from helpers.gate_checks import LIMITS, PERIOD, Driven, make_robot, position_command
from tci.gate.gate import Gate, SafeCommand
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformSwitch
from tci.messages.frames import Array, read_only
from tci.reasons import Code

ZERO = [0.0] * 6
ROBOT = make_robot(limits=LIMITS.model_copy(update={"torque": 5.0}), modes=CONTROL_MODES)
SERVOS = [2, 3]
REFERENCES = [Mode.POSITION, Mode.VELOCITY, Mode.IMPEDANCE]
"""Modes in which a servo follows a reference."""


def switch(mode: Mode, servos: Sequence[int] = SERVOS) -> PlatformSwitch:
    return PlatformSwitch(np.array(servos, dtype=np.intp), mode)


def order(mode: Mode, values: Sequence[float], servos: Sequence[int] = SERVOS) -> PlatformCommand:
    return PlatformCommand(mode, np.array(servos, np.intp), np.array(values), np.full(len(servos), np.inf))


def moving(mode: Mode, *, streams: bool) -> Driven:
    """Two servos that move at about 1 rad/s upwards in `mode`, and a third one in position mode."""
    driven = Driven(ROBOT, ZERO, streams=streams)
    driven.step(switch(mode), position_command([4], [1.9]))
    for _ in range(100):
        driven.step(order(mode, [1.0, 1.0] if mode is Mode.VELOCITY else [1.6, 1.6]))
    assert driven.speed[SERVOS].min() > 0.5
    return driven


def part(safe: SafeCommand, rows: Array) -> Array:
    return rows[[safe.servos.tolist().index(servo) for servo in SERVOS]]


@pytest.mark.parametrize("old", REFERENCES)
@pytest.mark.parametrize("new", REFERENCES)
def test_where_set_points_are_streamed_the_mode_changes_in_motion(old: Mode, new: Mode) -> None:
    driven = moving(old, streams=True)
    speed = driven.speed[SERVOS]
    away = order(new, [-1.0, -0.5] if new is Mode.VELOCITY else [-0.6, -0.3])
    safe = driven.step(switch(new), away)
    assert (safe.refusals, safe.clamped) == ((), ())
    assert {m for s, m in zip(safe.servos, safe.modes, strict=True) if s in SERVOS} == {new}
    assert part(safe, safe.velocity) == pytest.approx(speed, abs=0.1), "it goes on as it moved"
    assert (part(safe, safe.velocity) < speed).all(), "and turns in the same period"
    for _ in range(100):
        driven.step(away)
    assert (driven.speed[SERVOS] < -0.1).all()
    driven.assert_within_limits()


@pytest.mark.parametrize("old", REFERENCES)
@pytest.mark.parametrize("new", REFERENCES)
def test_a_switch_alone_brakes_within_the_limits(old: Mode, new: Mode) -> None:
    driven = moving(old, streams=True)
    assert driven.step(switch(new)).refusals == ()
    driven.settle()
    driven.assert_within_limits()
    way = np.diff(np.array(driven.path)[:, SERVOS], axis=0)
    if old is not new:
        assert way.min() > -1e-9, "without a way back"


def test_the_mode_changes_as_often_as_asked_and_no_limit_is_exceeded() -> None:
    random = np.random.default_rng(3)
    driven = moving(Mode.POSITION, streams=True)
    for _ in range(300):
        mode = REFERENCES[random.integers(3)]
        most = 2.5 if mode is Mode.VELOCITY else 2.0
        servos = random.permutation(6)[: random.integers(1, 6)]
        assert driven.step(switch(mode, servos)).refusals == ()
        for _ in range(random.integers(1, 40)):
            driven.step(order(mode, random.uniform(-most, most, len(servos)), servos))
    driven.assert_within_limits()


def test_a_compliant_servo_that_yielded_goes_on_from_where_it_is() -> None:
    driven = moving(Mode.IMPEDANCE, streams=True)
    for held in range(5):
        speed = driven.speed[2]
        driven.angles[2] -= held * np.deg2rad(1.0)  # a hand holds it back
        here = driven.angles[2]
        safe = driven.step(switch(Mode.POSITION) if held == 4 else order(Mode.IMPEDANCE, [1.6, 1.6]))
    assert safe.refusals == ()
    assert part(safe, safe.position)[0] == pytest.approx(here + speed * PERIOD, abs=1e-3)
    assert part(safe, safe.velocity)[0] == pytest.approx(speed, abs=0.1)


class Pushed:
    """One joint in torque mode, which moves as the gate's torques and a person's hand push it."""

    def __init__(self, *, streams: bool) -> None:
        self.gate = Gate(ROBOT, period=PERIOD, stale_after=0.05, streams=streams)
        self.q = self.v = self.time = 0.0
        self.step(switch(Mode.TORQUE, [2]))
        for _ in range(60):
            self.step(order(Mode.TORQUE, [2.0], [2]))
        assert self.v > 0.5

    def step(self, *orders: PlatformCommand | PlatformSwitch) -> SafeCommand:
        position, speed = np.zeros(6), np.zeros(6)
        position[2], speed[2] = self.q, self.v
        number = round(self.time / PERIOD)
        joints = JointReading(self.time, number, read_only(position), read_only(speed))
        safe = self.gate.step(orders, joints, self.time)
        before = self.q
        if safe.modes[0] is Mode.TORQUE:
            self.v += float(safe.torque[0]) / (5.0 / 40.0) * PERIOD
            self.q += self.v * PERIOD
        else:
            self.q, self.v = float(safe.position[0]), float(safe.velocity[0])
        assert abs(self.q - before) / PERIOD <= LIMITS.velocity * 1.01  # type: ignore[operator]
        self.time += PERIOD
        return safe


@pytest.mark.parametrize("mode", REFERENCES)
def test_from_torque_mode_a_moving_joint_goes_on_at_its_speed(mode: Mode) -> None:
    pushed = Pushed(streams=True)
    q, v = pushed.q, pushed.v
    safe = pushed.step(switch(mode, [2]))
    assert safe.refusals == ()
    assert safe.position[0] == pytest.approx(q + v * PERIOD, abs=1e-3)
    assert safe.velocity[0] == pytest.approx(v, abs=0.1)
    fastest = [pushed.v] + [pushed.step().velocity[0] for _ in range(300)]
    assert np.abs(np.diff(fastest)).max() <= LIMITS.acceleration * PERIOD * 1.001  # type: ignore[operator]
    assert fastest[-1] == pytest.approx(0.0, abs=1e-12)


def test_a_moving_joint_becomes_loose() -> None:
    driven = moving(Mode.POSITION, streams=True)
    safe = driven.step(switch(Mode.TORQUE), order(Mode.TORQUE, [1.0, -1.0]))
    assert safe.refusals == ()
    assert {m for s, m in zip(safe.servos, safe.modes, strict=True) if s in SERVOS} == {Mode.TORQUE}


@pytest.mark.parametrize("old", REFERENCES)
@pytest.mark.parametrize("new", REFERENCES)
def test_elsewhere_the_part_brakes_and_does_then_what_it_was_last_told(old: Mode, new: Mode) -> None:
    if old is new:
        return
    driven = moving(old, streams=False)
    least, last = ([0.3, 0.3], [-0.5, -0.5]) if new is Mode.VELOCITY else ([0.3, 0.3], [0.1, 0.0])
    safe = driven.step(switch(new), order(new, least))
    assert safe.refusals == ()
    told = safe.clamped[0]
    assert (told.code, told.names) == (Code.SWITCHES_AT_REST, ("joint2", "joint3"))
    braking = 1e-3 * float(told.text.split(" in ")[1].split(" ms")[0])
    assert told.text == f"arm switches to {new.value} in {1e3 * braking:.0f} ms, at rest"
    begun, before = driven.time, driven.speed[SERVOS].max()
    while True:
        safe = driven.step(order(new, last))
        assert safe.refusals == ()
        if safe.modes[safe.servos.tolist().index(2)] is new:
            break
        assert driven.speed[SERVOS].max() <= before, "it brakes from the first period on"
        before = driven.speed[SERVOS].max()
        assert driven.time < begun + 1.0
    assert driven.time - begun == pytest.approx(braking, abs=2 * PERIOD)
    if new is Mode.VELOCITY:
        for _ in range(100):
            driven.step(order(new, last))
        assert driven.speed[SERVOS] == pytest.approx(last, abs=1e-6)
    else:
        driven.settle()
        assert driven.angles[SERVOS] == pytest.approx(last, abs=1e-6)
    driven.assert_within_limits()
    assert driven.angles[4] > 0.5, "others of the group go on"


@pytest.mark.parametrize("velocity", ["measured", "unknown"])
@pytest.mark.parametrize("wide", [0.3, 1.6])
def test_who_pushes_a_held_part_a_little_does_not_delay_its_switch(velocity: str, wide: float) -> None:
    """Joints follow 10 ms late, and a person moves one to and fro at 8 degrees/s, by `wide` degrees from its
    reference: the switch waits only until it is within a degree."""
    gate = Gate(ROBOT, period=PERIOD, stale_after=0.05)
    late = [np.zeros(6)] * 6
    switched = told = None
    for count in range(400):
        swing = (
            np.deg2rad(np.abs((8.0 * (count - 200) * PERIOD) % (2.0 * wide) - wide)) if count > 200 else 0.0
        )
        here = late[-6] + [0.0, 0.0, swing, 0.0, 0.0, 0.0]
        speed = (late[-6] - late[-7 if len(late) > 6 else -6]) / PERIOD
        speed[2] += np.deg2rad(8.0) if count > 200 else 0.0
        measured = speed if velocity == "measured" else np.full(6, np.nan)
        joints = JointReading(count * PERIOD, count, read_only(here), read_only(measured))
        orders = [switch(Mode.VELOCITY)] if count == 0 else [order(Mode.VELOCITY, [0.8, 0.8])]
        if count >= 200:
            orders = [switch(Mode.POSITION)] if count == 200 else []
        safe = gate.step(orders, joints, count * PERIOD)
        if count == 200:
            told = 1e-3 * float(safe.clamped[0].text.split(" in ")[1].split(" ms")[0])
        if switched is None and count > 200 and gate.modes[2] is Mode.POSITION:
            switched = (count - 200) * PERIOD
        whole = late[-1].copy()
        whole[safe.servos] = safe.position
        late.append(whole)
    assert told is not None
    assert told == pytest.approx(0.034, abs=0.015), "the stop and the lag of 10 ms"
    assert switched is not None
    assert told <= switched
    assert switched == pytest.approx(told if wide < 1.0 else (wide - 1.0) / 8.0, abs=0.015)


def test_a_command_in_the_old_mode_and_a_bad_one_are_refused_while_the_part_brakes() -> None:
    driven = moving(Mode.VELOCITY, streams=False)
    driven.step(switch(Mode.POSITION))
    safe = driven.step(order(Mode.VELOCITY, [0.5, 0.5]), order(Mode.POSITION, [np.nan, 0.0]))
    assert [refusal.code for refusal in safe.refusals] == [Code.WRONG_MODE, Code.COMMAND_INVALID]
    assert driven.step(order(Mode.POSITION, [45.0, 90.0])).refusals[0].code is Code.LIKELY_DEGREES


def test_a_switch_back_and_a_hold_end_a_waiting_switch() -> None:
    for ends in ("back", "hold"):
        driven = moving(Mode.POSITION, streams=False)
        driven.step(switch(Mode.VELOCITY), order(Mode.VELOCITY, [-1.0, -1.0]))
        if ends == "back":
            assert driven.step(switch(Mode.POSITION)).clamped == ()
        else:
            driven.gate.hold("a pause")
        driven.settle()
        assert {*driven.step().modes} == {Mode.POSITION}
        assert driven.step(order(Mode.POSITION, [0.2, 0.2])).refusals == ()
        driven.settle()
        assert driven.angles[SERVOS] == pytest.approx([0.2, 0.2], abs=1e-6)
        driven.assert_within_limits()


def test_a_velocity_that_grew_old_while_the_part_braked_is_not_executed() -> None:
    robot = make_robot(limits=LIMITS.model_copy(update={"acceleration": 5.0}), modes=CONTROL_MODES)
    driven = Driven(robot, ZERO, streams=False)
    for _ in range(200):
        driven.step(order(Mode.POSITION, [1.6, 1.6]))
    driven.step(switch(Mode.VELOCITY), order(Mode.VELOCITY, [-1.0, -1.0]))
    for _ in range(500):
        driven.step()
    assert driven.gate.modes[2] is Mode.VELOCITY
    assert np.diff(np.array(driven.path)[:, 2]).min() >= -1e-9


def test_a_servo_that_never_rests_is_not_switched() -> None:
    pushed = Pushed(streams=False)
    safe = pushed.step(switch(Mode.POSITION, [2]))
    assert safe.clamped[0].code is Code.SWITCHES_AT_REST
    refusals = []
    for _ in range(600):
        pushed.v = 1.0  # a person moves it
        refusals += pushed.step().refusals
    assert [*map(str, refusals)] == ["joint2 kept moving; valid: switch to position at rest"]
    assert refusals[0].code is Code.IN_MOTION


def test_a_loose_joint_is_braked_and_switched_at_rest() -> None:
    pushed = Pushed(streams=False)
    pushed.step(switch(Mode.POSITION, [2]))
    for _ in range(200):
        safe = pushed.step()
    assert safe.modes == (Mode.POSITION,)
