"""Drift, noise and masks over hours of simulated frames: every touch is detected, and nothing else is
reported as a touch."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.baseline_oracle import NumpyBaseline
from helpers.flat_skin import OnePatch, skin_patch
from tci.errors import TciError
from tci.messages.frames import Array
from tci.robot.description import Sensor
from tci.skin.baseline import Baseline, BaselineSettings
from tci.skin.conditioning import ConditioningSettings
from tci.skin.health import HealthSettings
from tci.skin.kernels.baseline import Window, median

COUNT = 60
PERIOD = 0.05
PASCAL = 400.0
FALLING = Sensor(rest=240.0, pascal_per_count=-PASCAL, lowest=0.0, highest=255.0)
RING = np.array([(i, (i + 1) % COUNT) for i in range(COUNT)])


def conditioner(sensor: Sensor = FALLING, **settings: float) -> OnePatch:
    patch = skin_patch(sensor, np.arange(COUNT), neighbours=RING, rate=20.0)
    return OnePatch(patch, ConditioningSettings(**settings))


def raw(counts: Array) -> Array:
    """Returns raw values of an 8-bit sensor, whose values decrease with pressure, for deviations (n,) from
    rest."""
    return np.clip(np.rint(240.0 - counts), 0, 255).astype(np.uint8)


def play(subject: OnePatch, counts: Array, start: float = 0.0) -> Array:
    """Processes deviations (frames, n) [counts], one frame per period. Returns the pressures (frames, n)
    [Pa]."""
    return np.array([subject.pressure(raw(row), start + i * PERIOD) for i, row in enumerate(counts)])


def test_an_hour_of_drift_with_a_touch_of_half_an_hour() -> None:
    """The drift is 20 % of the range. It is common to the patch, with 2 % scatter between taxels. The force
    of the touch must stay within 10 %."""
    random = np.random.default_rng(1)
    seconds = np.arange(0.0, 3600.0, 1.0)
    slope = 0.2 * 255.0 * (1.0 + 0.02 * random.standard_normal(COUNT)) / 3600.0
    force = np.zeros(COUNT)
    force[10:14] = [30.0, 80.0, 60.0, 25.0]
    subject, held, elsewhere = conditioner(), [], 0.0
    for second in seconds:
        touch = force if 900.0 <= second < 2700.0 else 0.0
        for step in range(4):
            noisy = slope * second + touch + random.normal(0.0, 0.7, COUNT)
            pressure = subject.pressure(raw(noisy), second + step / 4.0)
            if second > 60.0:
                elsewhere = max(elsewhere, pressure[force == 0.0].max())
        if 900.0 <= second < 2700.0:
            held.append(pressure[10:14].sum() / PASCAL / force.sum())
    print(f"held touch {min(held):.3f} to {max(held):.3f} of its force, elsewhere {elsewhere:.0f} Pa")
    assert 0.9 <= min(held) <= max(held) <= 1.1
    assert elsewhere == 0.0
    assert subject.health.coverage == 1.0


def test_hours_of_noise_and_drift_invent_no_touch() -> None:
    """Simulates every frame of three hours, or of the number of hours in TCI_SOAK_HOURS."""
    import os

    hours = float(os.environ.get("TCI_SOAK_HOURS", "0.5"))
    random = np.random.default_rng(2)
    subject, invented = conditioner(Sensor(**{**dict(FALLING), "noise": 1.0})), 0
    frames = round(hours * 3600.0 / PERIOD)
    for start in range(0, frames, 2000):
        times = (start + np.arange(2000)) * PERIOD
        warmth = 10.0 * np.sin(2.0 * np.pi * times / 7200.0)
        counts = warmth[:, None] + random.normal(0.0, 0.8, (2000, COUNT))
        invented += int(np.count_nonzero(play(subject, counts, times[0])))
    print(f"{hours:g} h: {invented} values above rest")
    assert invented == 0


def test_every_touch_of_three_thresholds_is_found() -> None:
    random = np.random.default_rng(3)
    subject = conditioner(Sensor(**{**dict(FALLING), "noise": 1.0}))
    play(subject, random.normal(0.0, 0.8, (2000, COUNT)))
    found = touches = 0
    now = 2000 * PERIOD
    for _ in range(1000):
        taxel = int(random.integers(COUNT))
        strength = 3.0 * max(subject.baseline.threshold[taxel], 2.0)
        for step in range(4):
            counts = random.normal(0.0, 0.8, COUNT)
            counts[taxel] += strength if step < 2 else 0.0
            pressure = subject.pressure(raw(counts), now)
            now += PERIOD
            if step == 0:
                touches += 1
                found += pressure[taxel] > 0.0
    assert found == touches


@settings(max_examples=20, deadline=None)
@given(st.floats(0.005, 0.5))
def test_time_constants_do_not_depend_on_the_frame_rate(period: float) -> None:
    subject, now = conditioner(), 0.0
    while now < 60.0:
        subject.pressure(raw(np.full(COUNT, 1.4)), now)
        now += period
    assert subject.baseline.offset.mean() == pytest.approx(1.0, abs=0.05)


def test_below_rest_is_tracked_quickly() -> None:
    subject = conditioner()
    play(subject, np.full((60, COUNT), -12.0) * (np.arange(COUNT) == 5))
    # 3 s, after which the taxel counts as quiet
    assert subject.baseline.offset[5] == pytest.approx(-12.0, abs=2.0)
    touch = np.where(np.arange(COUNT) == 5, 28.0, 0.0)
    assert subject.pressure(raw(touch), 10.0)[5] / PASCAL == pytest.approx(40.0, abs=2.5)


def flicker(frames: int, seed: int = 4) -> Array:
    return np.random.default_rng(seed).normal(0.0, 0.8, (frames, COUNT))


def test_stuck_and_dead_taxels_are_masked_and_come_back() -> None:
    subject = conditioner()
    counts = flicker(1400)
    counts[:, 7], counts[:, 20] = 200.0, 0.0
    pressures = play(subject, counts)
    assert pressures[100, 7] > 0.0
    assert not pressures[-1, 7]
    assert subject.health.masked == {7: "stuck", 20: "dead"}
    assert subject.health.coverage == pytest.approx(58 / 60)
    play(subject, flicker(5, seed=5), start=1400 * PERIOD)
    assert subject.health.masked == {}


def test_a_lasting_press_that_saturates_is_no_stuck_taxel() -> None:
    subject = conditioner()
    counts = flicker(1400)
    counts[:, 30:33] += [[90.0, 300.0, 90.0]]
    pressures = play(subject, counts)
    assert subject.health.masked == {}
    assert subject.health.saturated == 1
    assert pressures[-1, 31] == pytest.approx(240.0 * PASCAL, rel=2e-3)


def test_a_noisy_taxel_is_masked() -> None:
    subject = conditioner()
    counts = flicker(1000)
    counts[:, 40] = np.random.default_rng(6).normal(0.0, 1.7, 1000) * np.linspace(1.0, 8.0, 1000)
    play(subject, counts)
    assert subject.health.masked in ({40: "noisy"}, {})
    assert subject.baseline.noise[40] > 1.5 * subject.baseline.noise[41]


def test_a_sensor_without_noise_is_not_masked_for_standing_still() -> None:
    subject = conditioner()
    play(subject, np.zeros((1400, COUNT)))
    assert subject.health.coverage == 1.0


def test_rezero_takes_the_present_as_rest() -> None:
    subject = conditioner()
    step = np.where(np.arange(COUNT) < 50, 40.0, 0.0)
    assert play(subject, np.repeat(step[None], 40, axis=0))[-1].max() > 0.0
    subject.rezero()
    assert not play(subject, np.repeat(step[None], 5, axis=0), start=5.0).any()


def test_smoothing_is_no_later_than_it_says() -> None:
    subject = conditioner(latency=0.2)
    counts = np.zeros((40, COUNT))
    counts[10:, 3] = 50.0
    pressures = play(subject, counts)[:, 3] / PASCAL
    assert pressures[10] > 0.0
    after = round(10 + 0.2 / PERIOD)
    assert pressures[after] >= 50.0 * (1.0 - np.exp(-1.0))


def test_a_response_curve_gives_the_same_pressure_on_another_sensor() -> None:
    """Compares a 12-bit sensor whose values grow with the square root of pressure with the 8-bit sensor whose
    values decrease with pressure."""
    pascal = np.linspace(0.0, 60e3, 30)
    points = tuple(zip(np.sqrt(pascal) * 8.0, pascal, strict=True))
    rising = Sensor(rest=100.0, pascal_per_count=1.0, lowest=0.0, highest=4095.0, response=points)
    for pressure in (5e3, 20e3, 50e3):
        one, other = conditioner(), conditioner(rising)
        first = one.pressure(np.rint(240.0 - FALLING.counts(np.full(COUNT, pressure))))[0]
        second = other.pressure(np.rint(100.0 + rising.counts(np.full(COUNT, pressure))))[0]
        assert second == pytest.approx(first, rel=0.05)


def test_the_same_frames_give_the_same_bits() -> None:
    one, other = (play(conditioner(), flicker(300)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_settings_are_checked() -> None:
    for make in (
        lambda: BaselineSettings(own=0.0),
        lambda: HealthSettings(constant=np.nan),
        lambda: ConditioningSettings(latency=-1.0),
    ):
        with pytest.raises(TciError, match="valid:"):
            make()


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
def test_the_median_is_numpys(values: list[float]) -> None:
    assert median(np.array(values)) == np.median(values)


@pytest.mark.parametrize("seed", range(6))
def test_the_kernel_estimates_as_numpy_does(seed: int) -> None:
    """Windows contain drift, touches, values below rest, constant and masked taxels, and new rest values."""
    random = np.random.default_rng(seed)
    pairs = random.integers(0, COUNT, (150, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    one, other = (
        kind(COUNT, span=255.0, floor=-15.0, noise=1.0, neighbours=pairs, settings=BaselineSettings())
        for kind in (Baseline, NumpyBaseline)
    )
    for number in range(40):
        touched = random.random(COUNT) < (0.9 if number % 10 == 9 else 0.2)
        mean = random.normal(0.1 * number, 1.0, COUNT) + random.normal(0.0, 20.0, COUNT) * touched
        window = Window(
            random.uniform(1.0, 2.0), mean, np.abs(mean - one.offset) + random.random(COUNT),
            random.exponential(1.0, COUNT), random.choice([0.0, 0.1, 0.5], COUNT),
        )  # fmt: skip
        healthy = random.random(COUNT) < 0.9
        for baseline in (one, other):
            if number in (4, 20):
                baseline.rezero(mean + 1.0)
            baseline.update(window, healthy)
        for name in ("offset", "noise", "threshold", "typical_noise"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-12, err_msg=name)
    assert np.ptp(one.noise) > 0.1
