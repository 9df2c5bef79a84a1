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
    BLOCK,
    BLOCK_SIZE,
    CHANNEL,
    END,
    ESTIMATES,
    FIRST,
    FULL,
    HIGHEST,
    LAYOUT,
    LOWEST,
    MEMORY,
    NODE,
    REST,
    ROOM,
    SIGN,
    STRAIGHT,
    TAXEL,
    ActiveTaxels,
    Estimates,
    LayoutArrays,
    Places,
    Single,
    SkinMemory,
)
from tci.support.compiled import compiled, inlined, reads, writes

SIGNAL, BEFORE, TOTAL, PEAK, SECOND_DIFFERENCE, CHANGES = range(6)
"""Rows of `SkinMemory.statistics`, with a column for each taxel.

The first two rows are the latest signal [counts] and the signal before. The other rows refer to the
estimation window: sum of the signals, largest absolute deviation from the rest value, sum of the absolute
second differences of the signal, and number of changes of the signal."""
REPEATS, REPEATED, LIVE, SATURATED = range(4)
"""Columns of `SkinMemory.blocks`, with a row for each block of up to 64 taxels:

- `REPEATS`: number of frames equal to the previous frame that are not yet added to the statistics.
- `REPEATED`: 1 if another equal frame would only be counted in `REPEATS`, else 0.
- `LIVE`: 1 if any taxel of the block is active, else 0.
- `SATURATED`: number of taxels of the block at the end of the sensor's range."""
STAMP, ELAPSED, FRAMES, IN_WINDOW, DIFFERENCES, DROPPED, CONSTANT, DUE, LEAST = range(9)
"""Columns of `SkinMemory.patches`, with a row for each patch:

- `STAMP`, `ELAPSED`: time [s] of the latest frame, and time [s] since the estimation window began.
- `FRAMES`: number of frames so far, counted up to 2.
- `IN_WINDOW`, `DIFFERENCES`: number of frames, and of second differences of the signals, in the window.
- `DROPPED`: number of values so far that were outside the sensor's range.
- `CONSTANT`: number of latest frames that equal the frame before and are not yet added to the statistics. The
  value is -1 if the next frame must be processed even if it is equal.
- `DUE`, `LEAST`: least length [s] and least number of frames of the window, which ends as soon as both are
  reached."""
ROWS, BLOCK_COLUMNS, PATCH_COLUMNS = 6, 4, 9
GAP = 1.0
"""Largest time [s] between two frames that is added to the length of an estimation window. Assumed: during a
longer pause the patch was not observed."""
_STEP, _FEW = 256, 8
"""Numbers of values that are examined at once, in the comparison of two frames (`_STEP`) and in the search
for active taxels (`_FEW`)."""


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
def _gather(raw: NDArray[Any], layout: LayoutArrays, block: int, begin: int, values: Single) -> None:
    """Copies the raw values of one block of up to 64 taxels from the frame `raw` into `values`, in the order
    of the taxels. `block` is the index of the block, and `begin` the index of the block's first taxel, both
    within the whole skin."""
    if layout.span[block, STRAIGHT]:
        own = raw[layout.span[block, FIRST] : layout.span[block, END]]
        for i in range(len(values)):
            values[i] = np.float32(own[i])
    else:
        channels = layout.channel[begin : begin + len(values)]
        for i in range(len(values)):
            values[i] = np.float32(raw[channels[i]])


@inlined
def _note(
    values: Single, sensor: Single, estimates: Estimates, statistics: Single, begin: int, frames: int
) -> tuple[int, int, int]:
    """Updates the statistics of successive taxels, of which `begin` is the first, with new raw values (k,).

    `sensor` (5,) is the patch's row of `LayoutArrays.sensor`. `frames` is the number of earlier frames, at
    most 2. Returns the number of values outside the sensor's range, which count as rest values; the number of
    saturated taxels; and 1 if any taxel is active, otherwise 0.
    """
    end = begin + len(values)
    signals, befores, totals = (
        statistics[SIGNAL, begin:end], statistics[BEFORE, begin:end], statistics[TOTAL, begin:end],
    )  # fmt: skip
    peaks, differences, changes = (
        statistics[PEAK, begin:end],
        statistics[SECOND_DIFFERENCE, begin:end],
        statistics[CHANGES, begin:end],
    )
    offsets, thresholds = estimates.offset[begin:end], estimates.threshold[begin:end]
    muted = estimates.muted[begin:end]
    lowest, highest, rest = sensor[LOWEST], sensor[HIGHEST], sensor[REST]
    sign, full = sensor[SIGN], sensor[FULL]
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
    return int(dropped), int(saturated), int(active)


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
def _deviate(begin: int, estimates: Estimates, statistics: Single, found: Single) -> None:
    """Writes the deviations [counts] of successive taxels, of which `begin` is the first, into `found`.

    The deviation of a taxel that is not active is written as 0.
    """
    end, nothing = begin + len(found), np.float32(0.0)
    signals, offsets = statistics[SIGNAL, begin:end], estimates.offset[begin:end]
    thresholds, muted = estimates.threshold[begin:end], estimates.muted[begin:end]
    for i in range(len(found)):
        deviation = signals[i] - offsets[i]
        active = (deviation > nothing) & (not deviation < thresholds[i]) & (not muted[i])
        found[i] = deviation if active else nothing


@inlined
def _is_zero(values: Single) -> bool:
    differs = False
    for i in range(len(values)):
        differs |= values[i] != np.float32(0.0)
    return not differs


@inlined
def _pressure(deviation: float, i: int, p: int, layout: LayoutArrays) -> float:
    """Returns the pressure [Pa] on a taxel of patch `p` with the given `deviation` [counts]. `i` is the index
    of the taxel within the whole skin."""
    counts, first, end = np.float64(deviation), layout.begin[p, NODE], layout.begin[p + 1, NODE]
    if first < end:
        counts = _response(counts, layout.nodes, first, end)
    pressure: float = layout.gain[i] * counts
    return pressure


@inlined
def _list_active(
    p: int, share: float, layout: LayoutArrays, estimates: Estimates, memory: SkinMemory
) -> None:
    """Writes the active taxels of patch `p` and their pressures [Pa] into `memory`.

    `share` is the weight (0 to 1) of the new frame in a low-pass filter of the pressure. With 1 the pressure
    is not filtered.
    """
    begin, stop = layout.begin[p, TAXEL], layout.begin[p + 1, TAXEL]
    smoothing, place = len(memory.smoothed) > 0, begin
    for block in range(layout.begin[p, BLOCK], layout.begin[p + 1, BLOCK]):
        if not (memory.blocks[block, LIVE] or smoothing):
            continue
        first = begin + (block - layout.begin[p, BLOCK]) * BLOCK_SIZE
        end = min(first + BLOCK_SIZE, stop)
        deviations = memory.room[: end - first]
        _deviate(first, estimates, memory.statistics, deviations)
        for few in range(first, end, _FEW):
            last = min(few + _FEW, end)
            if _is_zero(deviations[few - first : last - first]) and not smoothing:
                continue
            for i in range(few, last):
                deviation = deviations[i - first]
                pressure = _pressure(deviation, i, p, layout) if deviation > np.float32(0.0) else 0.0
                if smoothing:
                    before = memory.smoothed[i]
                    pressure = before + share * (pressure - before) if share < 1.0 else pressure
                    memory.smoothed[i] = pressure
                if pressure > 0.0:
                    memory.active[place], memory.pressure[place] = i - begin, pressure
                    place += 1
    memory.counts[p] = place - begin


@inlined
def _take(
    raw: NDArray[Any],
    last: NDArray[Any],
    p: int,
    layout: LayoutArrays,
    estimates: Estimates,
    memory: SkinMemory,
) -> None:
    """Updates the statistics in `memory` with one new frame of patch `p`, and copies the new raw values from
    `raw` to `last`."""
    status, statistics, blocks = memory.patches[p], memory.statistics, memory.blocks
    first, end = layout.begin[p, CHANNEL], layout.begin[p + 1, CHANNEL]
    begin, stop = layout.begin[p, TAXEL], layout.begin[p + 1, TAXEL]
    frames, whole = int(status[FRAMES]), np.int32(max(status[CONSTANT], 0.0))
    same = _same(raw, last, first, end)
    repeated = same
    for block in range(layout.begin[p, BLOCK], layout.begin[p + 1, BLOCK]):
        state = blocks[block]
        state[REPEATS] += whole
        equal = same or _same(raw, last, layout.span[block, FIRST], layout.span[block, END])
        if equal and state[REPEATED]:
            state[REPEATS] += 1
            continue
        i = begin + (block - layout.begin[p, BLOCK]) * BLOCK_SIZE
        values = memory.room[: min(BLOCK_SIZE, stop - i)]
        if state[REPEATS]:
            times = np.float32(state[REPEATS])
            for k in range(i, i + len(values)):
                statistics[TOTAL, k] += times * statistics[SIGNAL, k]
            state[REPEATS] = 0
        _gather(raw, layout, block, i, values)
        dropped, saturated, active = _note(values, layout.sensor[p], estimates, statistics, i, frames)
        status[DROPPED] += dropped
        state[SATURATED], state[LIVE] = saturated, active
        # All second differences of the next equal frame are then 0. Dropped values need a count per frame.
        state[REPEATED] = equal and frames > 0 and dropped == 0
        repeated &= state[REPEATED] != 0
    status[CONSTANT] = 0.0 if repeated and frames > 0 else -1.0
    if not same:
        a, b = last[first:end], raw[first:end]
        for i in range(len(a)):
            a[i] = b[i]


def _signature(raw: Any) -> Any:
    return int64(
        reads(1, raw), writes(1, raw), reads(1, int64), reads(1), float64, LAYOUT, ESTIMATES, MEMORY, ROOM
    )


@compiled(_signature(uint8), _signature(float32))
def condition(
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
        p = which[k]
        status, share = memory.patches[p], 1.0
        elapsed = 0.0 if np.isnan(status[STAMP]) else min(max(stamps[k] - status[STAMP], 0.0), GAP)
        status[STAMP] = stamps[k]
        same = status[CONSTANT] >= 0.0 and _same(
            raw, last, layout.begin[p, CHANNEL], layout.begin[p + 1, CHANNEL]
        )
        if same:
            status[CONSTANT] += 1.0
        else:
            _take(raw, last, p, layout, estimates, memory)
        if latency > 0.0 and elapsed > 0.0:
            share = 1.0 - np.exp(-elapsed / latency)
        if not same or latency > 0.0:
            _list_active(p, share, layout, estimates, memory)
        status[DIFFERENCES] += status[FRAMES] == 2.0
        status[FRAMES] = min(status[FRAMES] + 1.0, 2.0)
        status[IN_WINDOW] += 1.0
        status[ELAPSED] += elapsed
        ended += status[ELAPSED] >= status[DUE] and status[IN_WINDOW] >= status[LEAST]
    place = 0
    for p in range(len(memory.counts)):
        out.stamp[p], out.begin[p] = memory.patches[p, STAMP], place
        for i in range(layout.begin[p, TAXEL], layout.begin[p, TAXEL] + memory.counts[p]):
            out.active[place], out.pressure[place] = memory.active[i], memory.pressure[i]
            place += 1
    out.begin[len(memory.counts)] = place
    return ended
