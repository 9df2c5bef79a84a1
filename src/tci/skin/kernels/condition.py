"""One frame of one patch: raw values to deviations and pressure, and what the next lesson needs of it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import boolean, float32, float64, int64, uint8
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, returns, writes
from tci.frames import Array

Single = NDArray[np.float32]

SIGNAL, BEFORE, TOTAL, PEAK, BEND, CHANGED, RAW = range(7)
"""Rows of `memory`: this signal, the one before, and since the last lesson the sum of signals, the largest
deviation, the sum of the sizes of second differences, the number of changes; and the latest frame."""
ROWS = 7
LOWEST, HIGHEST, REST, SIGN, FULL = range(5)
"""Numbers of a `sensor`: its range, rest value and polarity, and the largest deviation."""
_BLOCK = 64


@inlined
def _note(
    sensor: Single,
    offset: Single,
    threshold: Single,
    silent: NDArray[np.bool_],
    frames: int,
    memory: Single,
    active: NDArray[np.uint8],
) -> tuple[int, int]:
    """Everything that each frame costs for each taxel; without branches, so that the processor takes eight
    taxels at once."""
    signals, befores, totals, peaks = memory[SIGNAL], memory[BEFORE], memory[TOTAL], memory[PEAK]
    bends, changes, raws = memory[BEND], memory[CHANGED], memory[RAW]
    lowest, highest, rest = sensor[LOWEST], sensor[HIGHEST], sensor[REST]
    sign, full = sensor[SIGN], sensor[FULL]
    bending = np.float32(1.0 if frames > 1 else 0.0)
    changing = np.float32(1.0 if frames > 0 else 0.0)
    nothing = np.float32(0.0)
    dropped, saturated = np.int32(0), np.int32(0)
    for i in range(len(signals)):
        raw, zero, last = raws[i], offset[i], signals[i]
        good = (raw >= lowest) & (raw <= highest)  # NaN is not
        signal = sign * (raw - rest)
        saturated += np.int32(good & (signal >= full))
        dropped += np.int32(not good)
        signal = signal if good else zero
        deviation = signal - zero
        active[i] = (deviation > nothing) & (deviation >= threshold[i]) & (not silent[i])
        bends[i] += bending * abs(signal - np.float32(2.0) * last + befores[i])
        changes[i] += changing if signal != last else nothing
        size, peak = abs(deviation), peaks[i]
        peaks[i] = size if size > peak else peak
        totals[i] += signal
        befores[i] = last
        signals[i] = signal
    return int(dropped), int(saturated)


@inlined
def response(counts: float, nodes: Array) -> float:
    last = nodes.shape[1] - 1
    k = 1
    while k < last and counts > nodes[0, k]:
        k += 1
    slope = (nodes[1, k] - nodes[1, k - 1]) / (nodes[0, k] - nodes[0, k - 1])
    return nodes[1, k - 1] + slope * (counts - nodes[0, k - 1])


def _signature(raw: Any) -> Any:
    return returns(int64, int64)(
        reads(1, raw), reads(1, int64), reads(1, float32), reads(1, float32), reads(1, float32),
        reads(1, boolean), reads(1), reads(2), writes(2, float32), writes(1, uint8), int64, float64, reads(1),
        writes(1),
    )  # fmt: skip


@compiled(_signature(uint8), _signature(float64))
def condition(
    values: NDArray[np.generic],
    channels: NDArray[np.intp],
    sensor: Single,
    offset: Single,
    threshold: Single,
    silent: NDArray[np.bool_],
    gain: Array,
    nodes: Array,
    memory: Single,
    active: NDArray[np.uint8],
    frames: int,
    share: float,
    before: Array,
    pressure: Array,
) -> tuple[int, int]:
    """Write `pressure` (taxels,) [Pa], which is zero; count values dropped and taxels saturated.

    `values` (channels,) raw, uint8 or float64; `sensor` see above; `offset`, `threshold`, `silent`, `gain`
    (taxels,); `nodes` (2, m) counts and pascal of the response, empty where it is linear with `gain` [Pa per
    count]; `memory` (ROWS, taxels); `active` (taxels,) room to work in; `frames` seen before this one, 2 for
    many; `share` of the new pressure where it is smoothed with the one `before`, 1 for all.
    """
    raws, signals = memory[RAW], memory[SIGNAL]
    for i in range(len(channels)):
        raws[i] = values[channels[i]]
    counted = _note(sensor, offset, threshold, silent, frames, memory, active)
    n = len(pressure)
    for block in range(0, n, _BLOCK):
        end = min(block + _BLOCK, n)
        part = active[block:end]
        some = np.uint8(0)
        for i in range(len(part)):
            some |= part[i]
        if some:
            for i in range(block, end):
                if active[i]:
                    counts = float(signals[i] - offset[i])
                    pressure[i] = gain[i] * (counts if nodes.shape[1] == 0 else response(counts, nodes))
    if share < 1.0:
        for i in range(n):
            pressure[i] = before[i] + share * (pressure[i] - before[i])
    return counted


def empty_memory(taxels: int) -> Single:
    """Memory before the first frame."""
    return np.zeros((ROWS, taxels), np.float32)
