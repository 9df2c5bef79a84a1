"""Conditioning of all patches in one loop gives the same results as plain NumPy for each patch, bit for bit,
over several windows."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.conditioner_oracle import OneConditioner
from helpers.flat_skin import PATCH, dense, skin_patch
from tci.errors import FrameError
from tci.messages import SkinFrame
from tci.skin.conditioning import Conditioner, ConditioningSettings
from tci.skin.layout import SkinLayout, SkinPatch

CURVE = ((0.0, 0.0), (10.0, 1e3), (100.0, 3e4), (300.0, 5e4))
SIZES = (1, 63, 64, 150, 3)
SENSORS = (
    {"rest": 240.0, "pascal_per_count": -420.0},
    {"rest": 20.0, "pascal_per_count": 100.0},
    {"rest": 240.0, "pascal_per_count": -420.0, "noise": 0.5, "lowest": 20.0, "highest": 250.0},
    {"rest": 30.0, "pascal_per_count": 1.0, "response": CURVE},
    {"rest": 0.0, "pascal_per_count": 1e4, "noise": 0.0, "highest": 1.0},
)


def patches(seed: int) -> list[SkinPatch]:
    random = np.random.default_rng(seed)
    made = []
    for number, (size, sensor) in enumerate(zip(SIZES, SENSORS, strict=True)):
        channels = np.arange(size) if size == 64 else random.permutation(size + 5)[:size]
        pairs = np.stack([np.arange(size - 1), np.arange(1, size)], axis=1)
        of = PATCH.sensor.model_copy(update=sensor)
        made.append(skin_patch(of, channels, name=f"p{number}", width=size + 5, neighbours=pairs))
    return made


def frame(one: SkinPatch, random: np.random.Generator, before: np.ndarray, kind: int) -> np.ndarray:
    """Returns a frame that is unchanged, noisy, touched, random, or partly NaN."""
    size, sensor = one.description.channels, one.description.sensor
    values = np.full(size, sensor.rest)
    if kind == 0:
        return before.copy()
    if kind > 1:
        values[random.integers(0, size) :][:20] += np.sign(sensor.pascal_per_count) * random.integers(0, 250)
    values = values + random.normal(0.0, 1.0, size)
    if kind == 5:
        values = random.integers(0, 256, size).astype(float)
    if kind == 6:
        values[random.random(size) < 0.1] = np.nan
        return values
    return np.clip(values, sensor.lowest, sensor.highest)


def same(whole: Conditioner, alone: list[OneConditioner]) -> None:
    for p, one in enumerate(alone):
        estimator = whole.estimators[p]
        np.testing.assert_array_equal(dense(whole.state, whole.layout, p), one.pressure)
        np.testing.assert_array_equal(estimator.baseline.offset, one.baseline.offset)
        np.testing.assert_array_equal(estimator.baseline.noise, one.baseline.noise)
        np.testing.assert_array_equal(estimator.health.state, one.health.state)
    assert [one.dropped for one in alone] == [one.dropped for one in whole.health.values()]
    assert [one.saturated for one in alone] == [one.saturated for one in whole.health.values()]


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 100_000),
    calm=st.booleans(),
    period=st.sampled_from([0.02, 0.004]),
    latency=st.sampled_from([0.0, 0.0, 0.05]),
    kind=st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
    wholes=st.booleans(),
)
def test_all_at_once_is_each_alone(
    seed: int, calm: bool, period: float, latency: float, kind: type, wholes: bool
) -> None:
    random, config = np.random.default_rng(seed), ConditioningSettings(latency=latency)
    made = patches(seed)
    alone = [OneConditioner(one, config, 0.5 * p / len(made)) for p, one in enumerate(made)]
    whole = Conditioner(SkinLayout.of(made), config)
    assert whole.layout.dtype == np.uint8
    floating = np.issubdtype(kind, np.floating) and not wholes
    last = [np.full(one.description.channels, one.description.sensor.rest).astype(kind) for one in made]
    for count in range(300):
        which = [p for p in range(len(SIZES)) if random.random() < 0.9] or [0]
        for p in which:
            if random.random() < 0.8:
                turn = int(random.choice([0, 0, 0, 0, 2] if calm else [0, 1, 2, 5, *[6] * floating]))
                values = frame(made[p], random, last[p], turn)
                last[p] = (np.rint(16.0 * values) / 16.0 if floating else np.rint(values)).astype(kind)
        stamp = period * count
        whole.step([SkinFrame(f"p{p}", stamp, count, last[p]) for p in which])
        for p in which:
            alone[p].see(last[p], stamp)
        for one in alone:
            one.update()
        whole.catch_up()
        same(whole, alone)
        if count == 200:
            for p, one in enumerate(alone):
                whole.rezero(f"p{p}")
                if one.frames:
                    one.rezero()


def readings(count: int) -> list[list[SkinFrame]]:
    """Yields frames of all patches, with noise and some touches."""
    random, made = np.random.default_rng(3), patches(3)
    return [
        [
            SkinFrame(f"p{p}", 0.02 * n, n, frame(one, random, np.zeros(0), 2 if n % 50 > 40 else
            1).astype(np.uint8)) for p, one in enumerate(made)
        ]
        for n in range(count)
    ]  # fmt: skip


def test_a_copy_and_a_pickle_go_on_with_the_same_bits() -> None:
    whole = Conditioner(SkinLayout.of(patches(3)))
    frames = readings(260)
    for one in frames[:130]:
        whole.step(one)
    branches = [whole, whole.copy(), pickle.loads(pickle.dumps(whole))]
    for one in frames[130:]:
        for branch in branches:
            branch.step(one)
        for branch in branches[1:]:
            np.testing.assert_array_equal(branch.state.active, whole.state.active)
            np.testing.assert_array_equal(branch.state.pressure, whole.state.pressure)
    assert [b.health for b in branches] == [whole.health] * 3
    assert len(whole.state.active)


@pytest.mark.parametrize(
    "wrong",
    [
        SkinFrame("p3", 9.0, 1000, np.zeros(7, np.uint8)),
        SkinFrame("p3", 9.0, 1000, np.zeros(155, np.complex128)),
        SkinFrame("nobody", 9.0, 1000, np.zeros(155, np.uint8)),
    ],
    ids=["shape", "type", "patch"],
)
def test_a_wrong_frame_among_right_ones_changes_nothing(wrong: SkinFrame) -> None:
    whole, other = (Conditioner(SkinLayout.of(patches(3))) for _ in range(2))
    frames = readings(120)
    for count, one in enumerate(frames):
        other.step(one)
        if count % 7 == 3:
            right = [f for f in one if f.patch != "p3"]
            with pytest.raises(FrameError):
                whole.step([*right, wrong])
        whole.step(one)
        np.testing.assert_array_equal(whole.state.pressure, other.state.pressure)


def test_numbers_of_another_type_switch_the_buffer_for_good() -> None:
    made = [skin_patch(PATCH.sensor, np.arange(70), name="p0")]
    whole = Conditioner(SkinLayout.of(made))
    values = np.full(70, 240, np.uint8)
    for count, kind in enumerate((np.uint8, np.float64, np.uint8, np.int64, np.float32)):
        touched = values.astype(kind)
        touched[5] = 200
        whole.step([SkinFrame("p0", 0.02 * count, count, touched)])
        assert whole.state.active.tolist() == [5]
        assert whole.state.pressure.tolist() == [40.0 * abs(PATCH.sensor.pascal_per_count)]


def test_a_taxel_that_was_dead_is_trusted_again_when_it_changes() -> None:
    random, (one,) = np.random.default_rng(3), [patches(3)[2]]
    whole, alone = Conditioner(SkinLayout.of([one])), OneConditioner(one, ConditioningSettings(), 0.0)
    channel = one.channels[7]
    for count in range(5000):
        values = frame(one, random, np.zeros(0), 1).astype(np.uint8)
        if 100 < count < 4500:
            values[channel] = 100
        alone.see(values, 0.02 * count)
        whole.step([SkinFrame(one.description.name, 0.02 * count, count, values)])
        np.testing.assert_array_equal(dense(whole.state, whole.layout, 0), alone.pressure)
        if count == 4400:
            assert whole.state.masked is not None
            assert np.flatnonzero(whole.state.masked).tolist() == [7]
    assert whole.state.masked is None
