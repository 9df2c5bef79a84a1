"""Frames of 8-bit patches at once give what each conditioner gives: bit for bit, also after lessons."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tci.robot.catalogue import load_robot
from tci.robot.description import Patch
from tci.skin.conditioning import Conditioner, ConditioningSettings
from tci.skin.octet_skin import OctetSkin

PATCH = load_robot("nao").patch("left_forearm")
CURVE = ((0.0, 0.0), (10.0, 1e3), (100.0, 3e4), (300.0, 5e4))
SIZES = (1, 63, 64, 150, 3)


def patch(size: int, **sensor: object) -> Patch:
    return PATCH.model_copy(update={"channels": size + 5, "sensor": PATCH.sensor.model_copy(update=sensor)})


def conditioners(seed: int) -> list[Conditioner]:
    random = np.random.default_rng(seed)
    sensors: list[dict[str, object]] = [
        {"rest": 240.0, "pascal_per_count": -420.0},
        {"rest": 20.0, "pascal_per_count": 100.0},
        {"rest": 240.0, "pascal_per_count": -420.0, "noise": 0.5, "lowest": 20.0, "highest": 250.0},
        {"rest": 30.0, "pascal_per_count": 1.0, "response": CURVE},
        {"rest": 0.0, "pascal_per_count": 1e4, "noise": 0.0, "highest": 1.0},
    ]
    made = []
    for size, sensor in zip(SIZES, sensors, strict=True):
        straight = size == 64
        channels = np.arange(size) if straight else random.permutation(size + 5)[:size]
        pairs = np.stack([np.arange(size - 1), np.arange(1, size)], axis=1)
        made.append(Conditioner(patch(size, **sensor), channels, neighbours=pairs))
    return made


def frame(one: Conditioner, random: np.random.Generator, before: np.ndarray, kind: int) -> np.ndarray:
    """Unchanged, flickering, touched or wild."""
    size, sensor = one.patch.channels, one.patch.sensor
    values = np.full(size, sensor.rest)
    if kind == 0:
        return before.copy()
    if kind > 1:
        values[random.integers(0, size) :][:20] += np.sign(sensor.pascal_per_count) * random.integers(0, 250)
    values = values + random.normal(0.0, 1.0, size)
    if kind == 5:
        values = random.integers(0, 256, size).astype(float)
    return np.clip(values, sensor.lowest, sensor.highest).astype(np.uint8)


def dense(whole: OctetSkin, p: int, taxels: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    result = np.zeros(SIZES[p])
    result[taxels] = pressure
    np.testing.assert_array_equal(result, whole.force[whole.begins[p] : whole.begins[p + 1]])
    assert whole.active[whole.begins[p] :][: whole.counts[p]].tolist() == taxels.tolist()
    return result


@settings(max_examples=20)
@given(seed=st.integers(0, 100_000), calm=st.booleans(), period=st.sampled_from([0.02, 0.004]))
def test_all_at_once_is_each_alone(seed: int, calm: bool, period: float) -> None:
    random = np.random.default_rng(seed)
    alone, together = conditioners(seed), conditioners(seed)
    whole = OctetSkin(together, [np.ones(size) for size in SIZES])
    assert whole.takes == [True] * len(SIZES)
    last = [np.full(one.patch.channels, int(one.patch.sensor.rest), np.uint8) for one in alone]
    felt = [np.zeros(size) for size in SIZES]
    for count in range(300):
        which = [p for p in range(len(SIZES)) if random.random() < 0.9] or [0]
        for p in which:
            if random.random() < 0.8:
                kind = int(random.choice([0, 0, 0, 0, 2] if calm else [0, 1, 2, 5]))
                last[p] = frame(alone[p], random, last[p], kind)
                last[p].setflags(write=bool(random.random() < 0.5))
        stamp = period * count
        pressed = whole.feel(which, [last[p] for p in which], [stamp] * len(which))
        if pressed is None:  # a taxel feels something whatever it reads: its patch goes the other way
            assert False in whole.takes
            return
        taxels, pressure, ends = pressed
        for p in which:
            felt[p] = alone[p].pressure(last[p], stamp)
        for p in range(len(SIZES)):
            own = slice(ends[p], ends[p + 1])
            np.testing.assert_array_equal(dense(whole, p, taxels[own], pressure[own]), felt[p])
            np.testing.assert_array_equal(together[p].masked, alone[p].masked)
            np.testing.assert_array_equal(together[p].baseline.offset, alone[p].baseline.offset)
            np.testing.assert_array_equal(together[p].baseline.noise, alone[p].baseline.noise)
            assert whole.saturated(p) == alone[p].health.saturated
        if count == 200:
            for p in range(len(SIZES)):
                whole.rezero(p)
                alone[p].rezero()


@settings(max_examples=10)
@given(seed=st.integers(0, 100_000))
def test_frames_that_come_again_are_counted(seed: int) -> None:
    """The same read-only arrays again and again, as senders of changes give them, and now and then others."""
    random = np.random.default_rng(seed)
    alone, together = conditioners(seed), conditioners(seed)
    whole = OctetSkin(together, [np.ones(size) for size in SIZES])
    which = list(range(len(SIZES)))
    frames = [np.full(one.patch.channels, int(one.patch.sensor.rest), np.uint8) for one in alone]
    for count in range(400):
        for p in which if random.random() < 0.1 else []:
            if random.random() < 0.5:
                frames[p] = frame(alone[p], random, frames[p], int(random.choice([0, 1, 2])))
        for values in frames:
            values.setflags(write=False)
        pressed = whole.feel(which, frames, [0.02 * count] * len(which))
        if pressed is None:  # a taxel feels something whatever it reads: its patch goes the other way
            assert False in whole.takes
            return
        for p in which:
            own = slice(pressed[2][p], pressed[2][p + 1])
            expected = alone[p].pressure(frames[p], 0.02 * count)
            np.testing.assert_array_equal(dense(whole, p, pressed[0][own], pressed[1][own]), expected)
    for p in which:
        whole.sync(p)
        np.testing.assert_array_equal(together[p].baseline.offset, alone[p].baseline.offset)
        np.testing.assert_array_equal(together[p].baseline.noise, alone[p].baseline.noise)
        assert together[p].lesson == alone[p].lesson


def test_what_was_silent_for_long_is_believed_again_when_it_changes() -> None:
    random = np.random.default_rng(3)
    alone, together = conditioners(3)[2], conditioners(3)[2]
    whole = OctetSkin([together], [np.ones(SIZES[2])])
    channel = alone.channels[7]
    for count in range(5000):
        values = frame(alone, random, np.zeros(0), 1)
        if 100 < count < 4500:
            values[channel] = 100
        expected = alone.pressure(values, 0.02 * count)
        pressed = whole.feel([0], [values], [0.02 * count])
        assert pressed is not None
        felt = np.zeros(SIZES[2])
        felt[pressed[0]] = pressed[1]
        np.testing.assert_array_equal(felt, expected)
        np.testing.assert_array_equal(together.masked, alone.masked)
        if count == 4400:
            assert alone.masked[7]
    assert not alone.masked[7]


def test_a_byte_that_a_sensor_cannot_send_changes_nothing() -> None:
    together = conditioners(0)
    whole = OctetSkin(together, [np.ones(size) for size in SIZES])
    which = list(range(len(SIZES)))
    frames = [np.full(one.patch.channels, int(one.patch.sensor.rest), np.uint8) for one in together]
    assert whole.feel(which, frames, [0.0] * len(which)) is not None
    before = [table.copy() for table in whole.tables]
    for p, wrong in ((2, 19), (2, 251), (4, 2)):
        spoilt = [*frames[:p], frames[p].copy(), *frames[p + 1 :]]
        spoilt[p][together[p].channels[1]] = wrong
        assert [whole.fits(k, spoilt[k]) for k in which] == [k != p for k in which]
        assert whole.feel(which, spoilt, [1.0] * len(which)) is None
        for one, other in zip(before, whole.tables, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("sensor", "words"), [({"axes": 3}, {}), ({}, {"latency": 0.1})], ids=["axes", "latency"]
)
def test_what_does_not_go_this_way(sensor: dict[str, object], words: dict[str, float]) -> None:
    one = Conditioner(patch(9, **sensor), np.arange(9), settings=ConditioningSettings(**words))
    assert OctetSkin([one], [np.ones(9)]).takes == [False]
