"""Estimates that are updated step by step in periods without a frame equal estimates that are updated in one
step."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.felt_skin import FeltSkin
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.skin.baseline import Baseline
from tci.skin.estimation import PatchEstimator
from tci.skin.health import TaxelHealth

NAO = load_robot("nao")
REST = np.zeros(len(NAO.servos))


def readings(count: int) -> list[Reading]:
    """Yields readings with noise at 50 Hz and one touch. One arm sends bytes, all other patches send
    floats."""
    random = np.random.default_rng(4)
    joints = JointReading(0.0, 0, np.array(initial_position(NAO)), REST)
    found = []
    for number in range(count):
        frames = []
        for patch in NAO.patches:
            values = patch.sensor.rest + random.integers(-2, 3, patch.channels)
            if 80 < number < 140:
                values[:5] -= 60
            values = np.clip(values, patch.sensor.lowest, patch.sensor.highest)
            kind = np.uint8 if patch.name.startswith("left") else np.float64
            frames.append(SkinFrame(patch.name, number / 50.0, number, values.astype(kind)))
        found.append(Reading(joints, tuple(frames)))
    return found


@pytest.mark.parametrize("times", [1, 3, 20])
def test_the_time_of_an_update_plays_no_part(times: int) -> None:
    patient, idle = FeltSkin(NAO), FeltSkin(NAO)
    for reading in readings(260):
        one, other = patient.update(reading), idle.update(reading)
        for name, state in one.items():
            assert np.array_equal(state.pressure, other[name].pressure)
            assert np.array_equal(state.masked, other[name].masked)
        for _ in range(times):
            idle.conditioner.update()
    assert patient.conditioner.health == idle.conditioner.health
    pairs = zip(patient.conditioner.estimators, idle.conditioner.estimators, strict=True)
    for (one, other), patch in zip(pairs, NAO.patches, strict=True):
        assert np.array_equal(one.baseline.offset, other.baseline.offset)
        assert np.ptp(one.baseline.noise) > 0.0 or patch.name == "head"


def test_one_window_at_a_time_between_two_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    perceiver, updated = Perceiver(GenericBody(NAO)), []
    update = PatchEstimator.update
    monkeypatch.setattr(
        PatchEstimator, "update", lambda one, *a: (updated.append(id(one)), update(one, *a))[1]
    )
    most = 0
    for number, reading in enumerate(readings(260)):
        before = len(updated)
        perceiver.step(reading, number / 50.0)
        assert len(updated) == before
        for period in range(1, 20):
            before = len(updated)
            perceiver.step(reading, number / 50.0 + period / 1000.0)
            most = max(most, len(updated) - before)
    assert most == 1
    assert len({*updated}) == len(NAO.patches)


def test_no_period_processes_a_whole_window(monkeypatch: pytest.MonkeyPatch) -> None:
    perceiver, done = Perceiver(GenericBody(NAO)), []
    for owner, name in ((Baseline, "update"), (TaxelHealth, "judge")):
        step = getattr(owner, name)
        monkeypatch.setattr(
            owner, name, lambda *a, _step=step, _name=name: (done.append(_name), _step(*a))[1]
        )
    for number, reading in enumerate(readings(260)):
        for period in range(20):
            before = len(done)
            perceiver.step(reading, number / 50.0 + period / 1000.0)
            assert len(done) - before <= 1
    assert done.count("update") == done.count("judge") > len(NAO.patches)


def test_frames_in_each_period_leave_half_a_window_to_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = NAO.model_copy(update={"patches": NAO.patches[:1]})
    perceiver, updated = Perceiver(GenericBody(robot)), []
    update = PatchEstimator.update
    monkeypatch.setattr(PatchEstimator, "update", lambda *a: (updated.append(None), update(*a))[1])
    for number, reading in enumerate(readings(260)):
        before = len(updated)
        perceiver.step(Reading(reading.joints, reading.skin[:1]), number / 50.0)
        assert len(updated) - before <= 1
    assert len(updated) >= 4
