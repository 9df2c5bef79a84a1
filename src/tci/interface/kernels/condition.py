"""One frame of one patch: raw values to deviations and pressure, and what the next lesson needs of it."""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tci.frames import Array

SIGNAL, BEFORE, TOTAL, PEAK, BEND, CHANGED = range(6)
"""Rows of `memory`: this signal, the one before, and since the last lesson the sum of signals, the largest
deviation, the sum of the sizes of second differences, the number of changes."""
ROWS = 6


@njit(cache=True)
def condition(
    values: Array,
    channels: NDArray[np.intp],
    sensor: Array,
    offset: Array,
    threshold: Array,
    silent: NDArray[np.bool_],
    gain: Array,
    nodes: Array,
    memory: Array,
    frames: int,
    share: float,
    pressure: Array,
) -> tuple[int, int]:
    """Write `pressure` (taxels,) [Pa] over the one before; count values dropped and taxels saturated.

    `values` (channels,) raw; `sensor` is lowest, highest, rest, sign and the largest deviation; `offset`,
    `threshold`, `silent`, `gain` (taxels,); `nodes` (2, m) counts and pascal of the response, empty where it
    is linear with `gain` [Pa per count]; `memory` (ROWS, taxels); `frames` seen before this one, 2 for many;
    `share` of the new pressure where it is smoothed, 1 for all.
    """
    lowest, highest, rest, sign, full = sensor
    dropped = 0
    saturated = 0
    for i in range(channels.size):
        raw = values[channels[i]]
        if lowest <= raw <= highest:  # NaN is not
            signal = sign * (raw - rest)
            if signal >= full:
                saturated += 1
        else:
            signal = offset[i]
            dropped += 1
        deviation = signal - offset[i]
        felt = 0.0
        if deviation > 0.0 and deviation >= threshold[i] and not silent[i]:
            felt = gain[i] * (deviation if nodes.shape[1] == 0 else _response(deviation, nodes))
        if share < 1.0:
            felt = pressure[i] + share * (felt - pressure[i])
        pressure[i] = felt
        last = memory[SIGNAL, i]
        if frames > 1:
            memory[BEND, i] += abs(signal - 2.0 * last + memory[BEFORE, i])
        if frames > 0 and signal != last:
            memory[CHANGED, i] += 1.0
        memory[BEFORE, i] = last
        memory[SIGNAL, i] = signal
        memory[TOTAL, i] += signal
        memory[PEAK, i] = max(memory[PEAK, i], abs(deviation))
    return dropped, saturated


@njit(cache=True)
def _response(counts: float, nodes: Array) -> float:
    last = nodes.shape[1] - 1
    k = 1
    while k < last and counts > nodes[0, k]:
        k += 1
    slope = (nodes[1, k] - nodes[1, k - 1]) / (nodes[0, k] - nodes[0, k - 1])
    return nodes[1, k - 1] + slope * (counts - nodes[0, k - 1])  # type: ignore[no-any-return]


def empty_memory(taxels: int) -> Array:
    """Memory before the first frame."""
    return np.zeros((ROWS, taxels))


@cache
def compiled() -> None:
    """Compile now, or load what was compiled before, so that no frame waits for it."""
    one = np.zeros(1)
    condition(
        one, np.zeros(1, np.intp), np.zeros(5), one, one, np.zeros(1, np.bool_), one,
        np.zeros((2, 0)), empty_memory(1), 0, 1.0, one.copy(),
    )  # fmt: skip
