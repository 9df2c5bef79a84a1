"""Hours of noise and drift: every touch is detected, and nothing else is reported as a touch."""

from __future__ import annotations

import os

import numpy as np
import pytest

from helpers.long_skin import PASCAL, RATE, TAXELS, block, bump, conditioner, sensor

SOAK = int(os.environ.get("TCI_SOAK", "0"))
HOURS = 24.0 if SOAK else 0.25
TOUCHES = 10_000 if SOAK else 500


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_contact_of_half_an_hour_keeps_its_force_while_the_skin_drifts(noise: float) -> None:
    """The drift is 20 % of the range in an hour, with 2 % scatter between taxels. The frame rate is 5 Hz to
    save computing time."""
    generator = np.random.default_rng(1)
    subject, rate = conditioner(), 5.0
    slope = 0.2 * 255.0 / 3600.0 * (1.0 + 0.02 * generator.standard_normal(TAXELS))
    touch = bump(6, 10, 60.0)
    shares, false = [], 0.0
    for start in np.arange(0.0, 3600.0, 60.0):
        times = start + np.arange(int(60 * rate)) / rate
        held = (times >= 900.0) & (times < 2700.0)
        signal = times[:, None] * slope + held[:, None] * touch
        felt_now = block(subject, signal, times, noise, generator)
        for stamp, here, pressure in zip(times, held, felt_now, strict=True):
            if here:
                shares.append(pressure[touch > 3.0].sum() / PASCAL)
            elif stamp > 20.0:  # the noise is estimated before the touch
                false = max(false, pressure.max())
    felt = np.array(shares).reshape(30, -1).mean(axis=1)
    assert np.abs(felt / touch[touch > max(7.0 * noise, 3.0)].sum() - 1.0).max() < 0.10
    assert np.abs(felt / felt[0] - 1.0).max() < 0.10
    assert false <= (0.0 if noise else 3.0 * PASCAL)
    assert subject.health.coverage == 1.0


@pytest.mark.parametrize(("period", "hours"), [(7200.0, HOURS), (2400.0, 0.7)])
def test_no_false_contact_in_noise_and_drift(period: float, hours: float) -> None:
    """The drift is so large that raw values reach the end of the sensor's range for some time."""
    generator = np.random.default_rng(2)
    subject = conditioner(None)
    noise = generator.uniform(0.5, 1.5, TAXELS)
    scatter = 1.0 + 0.02 * generator.standard_normal(TAXELS)
    false = 0
    for minute in range(int(60 * hours)):
        times = 60.0 * minute + np.arange(int(60 * RATE)) / RATE
        drift = 0.1 * 255.0 * np.sin(2 * np.pi * times / period)[:, None] * scatter
        for stamp, pressure in zip(times, block(subject, drift, times, noise, generator), strict=True):
            false += bool(pressure.any()) and stamp > 10.0  # the noise is estimated before the test
    assert false == 0
    assert subject.health.coverage == 1.0


@pytest.mark.parametrize("bits", [8, 12])
def test_touches_of_three_times_the_threshold_are_all_found(bits: int) -> None:
    generator = np.random.default_rng(3)
    subject = conditioner(sensor(bits))
    noise = 1.0
    for _ in block(subject, np.zeros((1500, TAXELS)), np.arange(1500) / RATE, noise, generator):
        pass
    missed = clock = 0
    for number in range(TOUCHES):
        times = 30.0 + clock + np.arange(20) / RATE
        clock += 0.5
        taxel = generator.integers(TAXELS)
        signal = np.zeros((20, TAXELS))
        signal[5:15, taxel] = 3.0 * subject.baseline.threshold[taxel]
        felt = np.array(list(block(subject, signal, times, noise, generator)))
        missed += not felt[5, taxel] > 0.0
        others = np.delete(felt, taxel, axis=1)
        assert not others.any(), number
        assert not felt[[*range(5), *range(15, 20)]].any(), number
    assert missed == 0
