"""Skin faults in the complete pipeline, with a reflex that responds to touches. The names of the tests
contain the number of the fault."""

from __future__ import annotations

import time

import numpy as np
import pytest

import tci
from helpers.felt import OTHER, PATCH, Felt, NoisySkin
from helpers.felt_skin import FeltSkin
from helpers.touches import BODY, one_field, see, touch
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.messages import LimbPlace

LEARNT = 5.0
"""Time [s] after which noise and rest values are estimated."""


def held(felt: Felt) -> set[GateState]:
    return {tick.sent.state for tick in felt.ticks}


def test_01_a_taxel_that_sticks_high_is_answered_once_at_most() -> None:
    driver = NoisySkin()
    driver.touch(LEARNT + 80.0, LEARNT + 81.0, OTHER.name)
    felt = Felt(driver, "taxel-stuck-high", at=LEARNT, duration=LEARNT + 84.0)
    assert len(felt.answers(PATCH.part)) <= 1
    assert felt.answers(OTHER.part) == [pytest.approx(80.0, abs=0.1)]
    assert felt.ticks[-1].skin.masked is not None, "it is masked"
    assert held(felt) == {GateState.RUN}


def test_01_a_taxel_that_sticks_high_is_no_touch_and_hides_none_of_its_arm() -> None:
    driver = NoisySkin()
    driver.touch(LEARNT + 3.0, LEARNT + 4.0)
    felt = Felt(driver, "taxel-stuck-high", at=LEARNT, duration=LEARNT + 6.0)
    assert felt.answers(PATCH.part) == [pytest.approx(3.0, abs=0.1)]


def test_02_beside_a_taxel_that_sticks_low_a_touch_is_still_answered() -> None:
    driver = NoisySkin()
    driver.touch(LEARNT + 80.0, LEARNT + 81.0)
    felt = Felt(driver, "taxel-stuck-low", at=LEARNT, duration=LEARNT + 84.0)
    assert felt.answers(PATCH.part) == [pytest.approx(80.0, abs=0.1)]
    place = LimbPlace(PATCH.segment, 0.5, 0.0)
    seen = felt.ticks[-1].perception
    (share,) = tci.GenericBody(driver.robot).coverage(seen, PATCH.part, [place], np.array([10.0]))
    assert 0.9 < share < 1.0


def test_03_a_dead_patch_stops_the_robot_since_its_fields_are_blind() -> None:
    felt = Felt(NoisySkin(), "dead-patch", at=LEARNT, duration=LEARNT + 80.0)
    last = felt.ticks[-1].sent
    assert last.state is GateState.STOP
    assert f"of {PATCH.part} is blind: 0% of its taxels are healthy; valid: 50% or more" in str(last.reason)
    assert len(felt.answers(PATCH.part)) <= 1


def test_04_values_that_are_no_number_are_dropped_and_counted() -> None:
    driver = NoisySkin(noise=0.0)
    driver.touch(1.0, 9.0)
    faulty, skin = FaultInjector(driver, [FaultPlan("nan-taxel", 2.0, 1.0)]), FeltSkin(driver.robot)
    for now in driver.ticks(duration=4.0):
        reading = faulty.read()
        (frame,) = (frame for frame in reading.skin if frame.patch == PATCH.name)
        bad = ~np.isfinite(frame.values[skin.surfaces[PATCH.name].channels])
        before = skin.conditioner.dropped
        felt = skin.update(reading)[PATCH.name]
        assert skin.conditioner.dropped - before == np.count_nonzero(bad)
        assert bad.any() == (2.0 <= now < 3.0)
        assert np.isfinite(felt.pressure).all()
        assert not felt.pressure[bad].any()
        assert bool((felt.pressure > 0.0).any()) == (now >= 1.0), "the others feel"
    assert skin.conditioner.health[PATCH.name].dropped == skin.conditioner.dropped > 1000


@pytest.mark.parametrize("count", [12, 60])
def test_05_saturated_taxels_are_one_touch_with_a_bounded_answer(count: int) -> None:
    driver = NoisySkin()
    driver.touch(LEARNT + 1.0, LEARNT + 2.0, count=count, counts=1e9)
    felt = Felt(driver, "saturated-taxel", at=LEARNT, duration=LEARNT + 1.5, response="meant")
    assert felt.answers(PATCH.part) == [pytest.approx(1.0, abs=0.1)], "the fault is outside the five fields"
    assert felt.answers(OTHER.part) == []
    assert held(felt) == {GateState.RUN}
    answer = felt.memory[PATCH.part]
    softer = NoisySkin()
    softer.touch(LEARNT + 1.0, LEARNT + 2.0, count=count, counts=120.0)
    other = Felt(softer, "saturated-taxel", at=LEARNT, duration=LEARNT + 1.5, response="meant")
    hard = other.memory[PATCH.part]
    assert 0.5 < answer.gain <= 1.0
    assert answer.gain == pytest.approx(hard.gain, rel=0.02), "no more than to half of that"
    (full,) = {
        int(tick.skin.by_patch(p.name for p in driver.robot.patches)[PATCH.name].max())
        for tick in felt.ticks[-2:]
    }
    assert full == pytest.approx(240 * 420, rel=0.01)
    commands = [one for tick in felt.ticks for one in tick.commands if one.part == PATCH.part]
    assert commands
    for one in commands:
        assert np.abs(one.values - answer.origin).max() <= np.abs(answer.field.motion).max() + 1e-9


def test_07_a_step_of_the_baseline_is_answered_once_and_is_rest_after_a_while() -> None:
    driver = NoisySkin()
    driver.touch(LEARNT + 50.0, LEARNT + 51.0)
    felt = Felt(driver, "baseline-step", at=LEARNT, duration=LEARNT + 54.0)
    before, after = [a for a in felt.answers(PATCH.part) if a < 49.0], felt.answers(PATCH.part)
    assert len(before) <= 1
    assert after[-1] == pytest.approx(50.0, abs=0.1), "and a touch is felt again"
    assert len(after) == len(before) + 1
    quiet = [tick for tick in felt.ticks if LEARNT + 40.0 < tick.now < LEARNT + 50.0]
    assert not any(tick.perception.contacts for tick in quiet)


def test_10_skin_that_falls_silent_while_the_joints_go_on_makes_the_robot_hold() -> None:
    felt = Felt(NoisySkin(), "skin-silent", at=LEARNT, duration=LEARNT + 2.0, lasts=1.0)
    silent = [tick for tick in felt.ticks if tick.sent.state is GateState.HOLD]
    assert silent[0].now - LEARNT == pytest.approx(0.25, abs=0.05)
    assert silent[-1].now - LEARNT == pytest.approx(1.0, abs=0.05)
    assert "has sent nothing for" in str(silent[0].sent.reason)
    assert felt.ticks[-1].sent.state is GateState.RUN


@pytest.mark.parametrize("name", ["out-of-order", "duplicates", "clock-jump", "nan-taxel"])
def test_04_11_12_13_a_touch_is_answered_once(name: str) -> None:
    driver, before = NoisySkin(), time.time
    driver.touch(LEARNT + 1.0, LEARNT + 2.0, count=40)
    felt = Felt(driver, name, at=LEARNT, duration=LEARNT + 5.0)
    assert felt.answers(PATCH.part) == [pytest.approx(1.0, abs=0.1)]
    assert felt.answers(OTHER.part) == []
    assert held(felt) == {GateState.RUN}
    assert time.time is before or name == "clock-jump"


def test_27_a_touch_during_a_withdrawal_is_the_same_one_and_the_limits_hold() -> None:
    driver = NoisySkin()
    driver.touch(LEARNT + 1.0, LEARNT + 1.3, count=12)
    driver.touch(LEARNT + 1.1, LEARNT + 1.5, count=40)
    driver.touch(LEARNT + 4.0, LEARNT + 4.5, count=12)
    felt = Felt(driver, "duplicates", at=LEARNT, duration=LEARNT + 6.0)
    assert felt.answers(PATCH.part) == [pytest.approx(1.0, abs=0.1), pytest.approx(4.0, abs=0.1)]
    moved = [tick.sent for tick in felt.ticks if tick.sent.servos.size]
    for sent in moved:
        limits = np.array([driver.robot.servos[servo].limits.velocity for servo in sent.servos], dtype=float)
        assert (np.abs(sent.velocity) <= limits).all()


def test_08_a_contact_without_any_force_moves_nothing() -> None:
    reflex = tci.WithdrawalReflex(fields=(one_field(radius=0.1),), response="meant")
    memory = reflex.init(BODY)
    for stamp in (0.0, 0.1, 0.2):
        none = see(touch(0.5, 0.0, [0.0, 0.0, 0.0], offsets=[0.01, 0.0, -0.01]), stamp=stamp)
        commands, memory = reflex.step(memory, none, BODY)
        assert commands == ()
    (command,), _ = reflex.step(memory, see(touch(0.5, 0.0, [50.0]), stamp=0.3), BODY)
    assert np.isfinite(command.values).all(), "and a touch is felt after it"


def test_09_taxels_that_have_no_weight_move_nothing() -> None:
    reflex = tci.WithdrawalReflex(fields=(one_field(radius=0.1, measure="weighted"),), response="meant")
    far = touch(0.5, 0.0, [50.0, 50.0], offsets=[0.4, -0.4])
    near = touch(0.5, 0.0, [50.0, 50.0, 4.0], offsets=[0.4, -0.4, 0.0])
    assert reflex.step(reflex.init(BODY), see(far), BODY)[0] == ()
    (command,), memory = reflex.step(reflex.init(BODY), see(near), BODY)
    assert memory["left_arm"].gain == pytest.approx(1.0), "the far ones don't count, nor with a minus"
    assert np.isfinite(command.values).all()


@pytest.mark.parametrize("count", [1, 30])
def test_17_thirty_contacts_at_once_are_one_withdrawal_of_each_arm(count: int) -> None:
    driver = NoisySkin()
    driver.scatter(LEARNT + 1.0, LEARNT + 2.0, count)
    felt = Felt(driver, "duplicates", at=LEARNT, duration=LEARNT + 4.0)
    most = max(len(tick.perception.contacts) for tick in felt.ticks if tick.now > LEARNT)
    assert most >= count
    assert all(len(felt.answers(part)) <= 1 for part in ("left_arm", "right_arm"))
    assert held(felt) == {GateState.RUN}
    assert all(len(tick.commands) <= 2 for tick in felt.ticks)
