"""The compiled loop equals its NumPy twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tci.skin.kernels.condition import condition, empty_memory

SENSOR = np.array([0.0, 255.0, 240.0, -1.0, 240.0], np.float32)
CURVE = np.array([[0.0, 10.0, 100.0, 300.0], [0.0, 1e3, 3e4, 5e4]])


def twin(values, channels, offset, threshold, silent, gain, nodes, memory, frames, share, before):
    """The same with arrays."""
    lowest, highest, rest, sign, full = SENSOR
    raw = values[channels]
    good = (raw >= lowest) & (raw <= highest)
    signal = np.where(good, sign * (np.where(good, raw, 0.0) - rest), offset)
    deviation = signal - offset
    felt = gain * (np.interp(deviation, *nodes) if nodes.size else deviation)
    felt = np.where((deviation > 0.0) & (deviation >= threshold) & ~silent, felt, 0.0)
    pressure = before + share * (felt - before) if share < 1.0 else felt
    last, earlier, total, peak, bend, changed, _ = memory
    after = np.array(
        [
            signal,
            last,
            total + signal,
            np.maximum(peak, np.abs(deviation)),
            bend + (np.abs(signal - 2.0 * last + earlier) if frames > 1 else 0.0),
            changed + ((signal != last) if frames else 0.0),
            raw,
        ]
    )
    return pressure, after, int((~good).sum()), int((good & (signal >= full)).sum())


@pytest.mark.parametrize("nodes", [np.zeros((2, 0)), CURVE], ids=["linear", "curve"])
@pytest.mark.parametrize("kind", [np.uint8, np.float64])
@given(seed=st.integers(0, 10_000), share=st.sampled_from([1.0, 0.3]))
def test_equals_numpy(kind: type, nodes: np.ndarray, seed: int, share: float) -> None:
    random = np.random.default_rng(seed)
    channels = random.permutation(24)[:20]
    offset, threshold = random.normal(0.0, 3.0, 20), random.uniform(0.0, 9.0, 20)
    silent, gain = random.random(20) < 0.1, random.uniform(1.0, 2.0, 20)
    offset, threshold = offset.astype(np.float32), threshold.astype(np.float32)
    memory, before, work = empty_memory(20), np.zeros(20), np.zeros(20, np.uint8)
    for frames in (0, 1, 2, 2, 2):
        values = random.integers(-20, 270, 24).astype(float)
        values[random.random(24) < 0.05] = np.nan
        if kind is np.uint8:
            values = np.clip(np.nan_to_num(values), 0, 255).astype(np.uint8)
        expected = twin(
            values.astype(float),
            channels,
            offset,
            threshold,
            silent,
            gain,
            nodes,
            memory,
            frames,
            share,
            before,
        )
        pressure = np.zeros(20)
        counts = condition(
            values, channels, SENSOR, offset, threshold, silent, gain, nodes, memory, work, frames, share,
            before, pressure,
        )  # fmt: skip
        np.testing.assert_allclose(pressure, expected[0], rtol=1e-5, atol=1e-3)
        np.testing.assert_allclose(memory, expected[1], rtol=1e-5, atol=1e-4)
        assert counts == expected[2:]
        before = pressure
