"""Turns raw values into active taxels with pressure (conditioning), in compiled loops.

The loops also compute statistics of the signals, from which rest values and noise are estimated.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import float32, float64, int64, uint8
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.skin.kernels.arrays import (
    ESTIMATES,
    LAYOUT,
    MEMORY,
    ROOM,
    ActiveTaxels,
    Estimates,
    LayoutArrays,
    Places,
    Records,
    Single,
    SkinMemory,
    Statistics,
)
from tci.support.compiled import compiled, inlined, reads, writes

GAP = 1.0
"""Largest time [s] between two frames that is added to the length of an estimation window. Assumed: during a
longer pause the patch was not observed."""
_STEP = 256
"""Number of values that are compared at once."""


@inlined
def _same(raw: NDArray[Any], last: NDArray[Any], begin: int, end: int) -> bool:
    """Returns True if two raw frames have equal values in the channels from `begin` to `end` - 1."""
    for first in range(begin, end, _STEP):
        a, b = raw[first : min(first + _STEP, end)], last[first : min(first + _STEP, end)]
        differs = False
        for i in range(len(a)):
            differs |= a[i] != b[i]
        if differs:
            return False
    return True


@inlined
def _note(
    values: Single, patch: Records, estimates: Estimates, statistics: Statistics, frames: int
) -> tuple[int, int, bool]:
    """Updates the statistics of a patch's taxels with new raw values (k,). `frames` is the number of earlier
    frames, at most 2.

    Returns the number of values outside the sensor's range, which count as rest values; the number of
    saturated taxels; and True if any taxel is active.
    """
    begin, end = patch.taxel, patch.taxel_end
    signals, befores, totals = (
        statistics.signal[begin:end], statistics.before[begin:end], statistics.total[begin:end],
    )  # fmt: skip
    peaks, differences, changes = (
        statistics.peak[begin:end],
        statistics.second_difference[begin:end],
        statistics.changes[begin:end],
    )
    offsets, thresholds = estimates.offset[begin:end], estimates.threshold[begin:end]
    muted = estimates.muted[begin:end]
    lowest, highest, rest = patch.lowest, patch.highest, patch.rest
    sign, full = patch.sign, patch.full
    differing = np.float32(1.0 if frames > 1 else 0.0)
    changing = np.float32(1.0 if frames > 0 else 0.0)
    nothing = np.float32(0.0)
    dropped, saturated, active = np.int32(0), np.int32(0), np.int32(0)
    for i in range(len(values)):
        value, offset, last = values[i], offsets[i], signals[i]
        good = (value >= lowest) & (value <= highest)  # NaN is not
        signal = sign * (value - rest)
        saturated += np.int32(good & (signal >= full))
        dropped += np.int32(not good)
        signal = signal if good else offset
        deviation = signal - offset
        active |= np.int32((deviation > nothing) & (deviation >= thresholds[i]) & (not muted[i]))
        differences[i] += differing * abs(signal - np.float32(2.0) * last + befores[i])
        changes[i] += changing if signal != last else nothing
        size, peak = abs(deviation), peaks[i]
        peaks[i] = size if size > peak else peak
        totals[i] += signal
        befores[i] = last
        signals[i] = signal
    return int(dropped), int(saturated), bool(active > 0)


@inlined
def _response(counts: float, nodes: Array, first: int, end: int) -> float:
    """Returns the pressure [Pa] at a deviation of `counts` on a response curve.

    The points of the curve are the columns from `first` to `end` - 1 of `nodes`, with deviation [counts] and
    pressure [Pa]. The curve is linear between these points and beyond the last point.
    """
    k = first + 1
    while k < end - 1 and counts > nodes[0, k]:
        k += 1
    slope = (nodes[1, k] - nodes[1, k - 1]) / (nodes[0, k] - nodes[0, k - 1])
    pressure: float = nodes[1, k - 1] + slope * (counts - nodes[0, k - 1])
    return pressure


@inlined
def pressure_of(deviation: float, i: int, patch: Records, layout: LayoutArrays) -> float:
    """Returns the pressure [Pa] at a `deviation` [counts] of taxel `i` of the whole skin."""
    counts = np.float64(deviation)
    if patch.node < patch.node_end:
        counts = _response(counts, layout.nodes, patch.node, patch.node_end)
    pressure: float = layout.gain[i] * counts
    return pressure


@inlined
def _list_active(
    patch: Records, share: float, layout: LayoutArrays, estimates: Estimates, memory: SkinMemory
) -> int:
    """Writes the active taxels of a patch and their pressures [Pa] into `memory`, and returns their number.

    `share` is the weight (0 to 1) of the new frame in a low-pass filter of the pressure. With 1 the pressure
    is not filtered.
    """
    begin, smoothing, place = patch.taxel, len(memory.smoothed) > 0, patch.taxel
    signals = memory.statistics.signal
    for i in range(begin, patch.taxel_end):
        deviation = signals[i] - estimates.offset[i]
        active = (
            (deviation > np.float32(0.0)) & (deviation >= estimates.threshold[i]) & (not estimates.muted[i])
        )
        if not (active or smoothing):
            continue
        pressure = pressure_of(deviation, i, patch, layout) if active else 0.0
        if smoothing:
            before = memory.smoothed[i]
            pressure = before + share * (pressure - before) if share < 1.0 else pressure
            memory.smoothed[i] = pressure
        if pressure > 0.0:
            memory.active[place], memory.pressure[place] = i - begin, pressure
            place += 1
    return int(place - begin)


@inlined
def _take(
    raw: NDArray[Any],
    last: NDArray[Any],
    equal: bool,
    patch: Records,
    state: Records,
    layout: LayoutArrays,
    estimates: Estimates,
    memory: SkinMemory,
) -> bool:
    """Updates the statistics with one new frame of a patch, and copies its raw values from `raw` to `last`.
    `equal` is True if both are equal. Returns True if any taxel is active."""
    begin, end, statistics = patch.taxel, patch.taxel_end, memory.statistics
    if state.repeats > 0:
        times = np.float32(state.repeats)
        for i in range(begin, end):
            statistics.total[i] += times * statistics.signal[i]
    values, channels = memory.room[: end - begin], layout.channel[begin:end]
    for i in range(len(values)):
        values[i] = np.float32(raw[channels[i]])
    dropped, state.saturated, live = _note(values, patch, estimates, statistics, state.frames)
    state.dropped += dropped
    # All second differences of the next equal frame are then 0. Dropped values need a count per frame.
    state.repeats = 0 if equal and state.frames > 0 and dropped == 0 else -1
    if not equal:
        a, b = last[patch.channel : patch.channel_end], raw[patch.channel : patch.channel_end]
        for i in range(len(a)):
            a[i] = b[i]
    return live


def _signature(raw: Any) -> Any:
    return int64(
        reads(1, raw), writes(1, raw), reads(1, int64), reads(1), float64, LAYOUT, ESTIMATES, MEMORY, ROOM
    )


def _condition(
    raw: NDArray[Any],
    last: NDArray[Any],
    which: Places,
    stamps: Array,
    latency: float,
    layout: LayoutArrays,
    estimates: Estimates,
    memory: SkinMemory,
    out: ActiveTaxels,
) -> int:
    """Turns new raw frames of the patches `which` (k,) into active taxels and their pressure [Pa], which are
    written to `out`.

    `raw` (c,) are the present raw values of all channels. `last` (c,) are those of the previous frame; the
    call replaces them by the new values. `stamps` (k,) [s] are the times of the frames. `latency` [s] is the
    time constant of a low-pass filter, or 0 for no filter. The call also updates the statistics in `memory`,
    from which rest values and noise are estimated at the end of each estimation window. Returns the number of
    patches whose window has ended.
    """
    ended = 0
    for k in range(len(which)):
        patch, state, share = layout.patches[which[k]], memory.patches[which[k]], 1.0
        elapsed = 0.0 if np.isnan(state.stamp) else min(max(stamps[k] - state.stamp, 0.0), GAP)
        state.stamp = stamps[k]
        if latency > 0.0 and elapsed > 0.0:
            share = 1.0 - np.exp(-elapsed / latency)
        equal = _same(raw, last, patch.channel, patch.channel_end)
        counted, live = equal and state.repeats >= 0, False
        if counted:
            state.repeats += 1
        else:
            live = _take(raw, last, equal, patch, state, layout, estimates, memory)
            state.active = 0
        if live or latency > 0.0:
            state.active = _list_active(patch, share, layout, estimates, memory)
        state.differences += state.frames == 2
        state.frames = min(state.frames + 1, 2)
        state.in_window += 1
        state.elapsed += elapsed
        ended += state.elapsed >= state.due and state.in_window >= state.least
    place = 0
    for p in range(len(memory.patches)):
        state, begin = memory.patches[p], layout.patches[p].taxel
        out.stamp[p], out.begin[p] = state.stamp, place
        for i in range(begin, begin + state.active):
            out.active[place], out.pressure[place] = memory.active[i], memory.pressure[i]
            place += 1
    out.begin[len(memory.patches)] = place
    return ended


condition = compiled(_signature(uint8))(_condition)
condition_of_floats = compiled(_signature(float32))(_condition)
"""For raw values that bytes can't hold."""
