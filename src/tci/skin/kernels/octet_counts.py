"""What must be known of each taxel of 8-bit skin for its next lesson, counted in bytes.

What `condition` keeps of each taxel in single precision is kept here as bytes and counted in 16 bits, and is
`spill`ed into its memory before the counts overflow and before something is learnt. Bytes are turned so that
pressure raises them, and compared with the least byte that is felt. A block of 64 taxels that reads as in the
two frames before is counted, nothing more.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import float32, int32, int64, uint8, uint16, void
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, writes
from tci.frames import Array
from tci.skin.kernels.condition import (
    BEFORE,
    BEND,
    CHANGED,
    PEAK,
    REST,
    ROWS,
    SIGN,
    SIGNAL,
    TOTAL,
    Single,
)

BLOCK = 64
_BLOCK, _EIGHT = np.uint64(64), np.uint64(8)
NOW, LAST, EARLIER, LOW, HIGH, CHANGES, LIMIT = range(7)
"""Rows of `octets`: three frames, extremes and number of changes since the last spill, and the largest byte
that is not felt."""
SUM, BENDS = range(2)
"""Rows of `words`: sum of bytes and of the sizes of second differences since the last spill."""
STILL, SETTLED, LIVE, ENDS = range(4)
"""Rows of `blocks`: frames that only were counted, whether the last two frames are alike, whether something
is felt, taxels at the end of their range."""
BEGIN, TAXELS, FIRST, COUNT, TURN, END, STRAIGHT, NODE, NODES, SOURCE = range(10)
"""Columns of `table`: a patch's first taxel and their number, first block and their number, what turns bytes
(0 or 255), the largest byte that is not at the end of the range, whether channels are taxels, place and
number of its response's nodes, and where its channels begin in all frames."""
STAMP, ELAPSED, FRAMES, IN_LESSON, BENT, SINCE, REPEATS, SATURATED, DUE, LEAST, CALM = range(11)
"""Columns of `state`: time of the latest frame [s] (NaN: none) and since the lesson began, frames seen, up to
2, and in this lesson, second differences in it, frames since the last spill, frames that came again, taxels
at the end of their range, when the next lesson is due, the least of frames in it; frames that all blocks
still have to count, -1 where one is not settled."""
LONGEST = 120
"""Frames that the counts can hold: second differences are up to 510."""

Octets = NDArray[np.uint8]
Words = NDArray[np.uint16]
Numbers = NDArray[np.int64]


@inlined
def signal_of(octet: Any, turn: Any, sensor: Single) -> Any:
    raw = np.float32(octet ^ turn)
    return sensor[SIGN] * (raw - sensor[REST])


@inlined
def _catch_up(octets: Octets, words: Words, blocks: NDArray[np.int32], b: int) -> None:
    """Note what was only counted of a block."""
    last, low, high, total = octets[LAST], octets[LOW], octets[HIGH], words[SUM]
    times = np.uint16(blocks[STILL, b])
    blocks[STILL, b] = 0
    for i in range(np.uint64(b * BLOCK), np.uint64(b * BLOCK + BLOCK)):
        t = last[i]
        total[i] = np.uint16(total[i] + times * np.uint16(t))
        low[i] = t if t < low[i] else low[i]
        high[i] = t if t > high[i] else high[i]


@inlined
def _note(octets: Octets, words: Words, b: int, bending: Any, changing: Any) -> None:
    """Note a new frame of a block, loop by loop: each is done 16 or 32 taxels at once."""
    now, last, earlier = octets[NOW], octets[LAST], octets[EARLIER]
    low, high, changes, total, bends = octets[LOW], octets[HIGH], octets[CHANGES], words[SUM], words[BENDS]
    start, stop = np.uint64(b * BLOCK), np.uint64(b * BLOCK + BLOCK)
    for i in range(start, stop):
        ends, middle = np.uint16(np.uint16(now[i]) + np.uint16(earlier[i])), np.uint16(2 * np.uint16(last[i]))
        more = ends if ends > middle else middle
        less = middle if ends > middle else ends
        bends[i] = np.uint16(bends[i] + (np.uint16(more - less) & bending))
    for i in range(start, stop):
        changes[i] = np.uint8(changes[i] + (np.uint8(now[i] != last[i]) & changing))
    for i in range(start, stop):
        t = now[i]
        low[i] = t if t < low[i] else low[i]
        high[i] = t if t > high[i] else high[i]
    for i in range(start, stop):
        total[i] = np.uint16(total[i] + np.uint16(now[i]))
    for i in range(start, stop):
        earlier[i] = last[i]
        last[i] = now[i]


@inlined
def alive(octets: Octets, row: int, b: int) -> int:
    some, seen, limit = np.uint8(0), octets[row], octets[LIMIT]
    for i in range(np.uint64(b * BLOCK), np.uint64(b * BLOCK + BLOCK)):
        some |= np.uint8(seen[i] > limit[i])
    return np.int32(some)  # type: ignore[return-value] # an int to Python


@inlined
def _count_calm(p: int, table: Numbers, blocks: NDArray[np.int32], state: Array) -> None:
    """Count in each block the frames in which nothing changed."""
    if state[p, CALM] > 0.0:
        for b in range(table[p, FIRST], table[p, FIRST] + table[p, COUNT]):
            blocks[STILL, b] += int(state[p, CALM])
        state[p, CALM] = 0.0


@inlined
def update(
    p: int,
    table: Numbers,
    octets: Octets,
    words: Words,
    blocks: NDArray[np.int32],
    state: Array,
) -> None:
    """Go through the blocks of a patch whose new bytes are there."""
    start, stop = np.uint64(table[p, FIRST]), np.uint64(table[p, FIRST] + table[p, COUNT])
    state[p, SINCE] += 1
    whole = octets.view(np.uint64)
    fresh, last = whole[NOW], whole[LAST]
    changed = np.uint64(0)
    for b in range(start, stop, _BLOCK):
        for i in range(b * _EIGHT, min(b + _BLOCK, stop) * _EIGHT):
            changed |= fresh[i] ^ last[i]
        if changed != 0:
            break
    if changed == 0 and state[p, CALM] >= 0.0:
        state[p, CALM] += 1
        return
    _count_calm(p, table, blocks, state)
    now = octets[NOW]
    still, settled, live, full = blocks[STILL], blocks[SETTLED], blocks[LIVE], blocks[ENDS]
    bending = np.uint16(0xFFFF if state[p, FRAMES] > 1 else 0)
    changing = np.uint8(1 if state[p, FRAMES] > 0 else 0)
    end = np.uint8(table[p, END])
    saturated = 0
    for b in range(start, stop):
        other = np.uint64(0)
        for i in range(b * _EIGHT, b * _EIGHT + _EIGHT):  # eight octets each
            other |= fresh[i] ^ last[i]
        if other == 0 and settled[b]:
            still[b] += 1
        else:
            if still[b]:
                _catch_up(octets, words, blocks, np.int64(b))
            _note(octets, words, np.int64(b), bending, changing)
            settled[b] = other == 0
            live[b] = alive(octets, NOW, np.int64(b))
            ends = np.uint8(0)
            for i in range(np.uint64(b * _BLOCK), np.uint64(b * _BLOCK + _BLOCK)):
                ends = np.uint8(ends + np.uint8(now[i] > end))
            saturated += np.int64(ends) - full[b]
            full[b] = ends
    state[p, SATURATED] += saturated
    state[p, CALM] = 0.0 if changed == 0 else -1.0


@inlined
def add_up(
    p: int,
    table: Numbers,
    sensor: Single,
    offset: Single,
    memory: Single,
    octets: Octets,
    words: Words,
    blocks: NDArray[np.int32],
    state: Array,
) -> None:
    begin, count, first = table[p, BEGIN], table[p, TAXELS], table[p, FIRST]
    own = memory[ROWS * begin : ROWS * (begin + count)].reshape(ROWS, count)
    frames, turn, s = int(state[p, SINCE]), np.uint8(table[p, TURN]), sensor[p]
    if frames:
        _count_calm(p, table, blocks, state)
        for b in range(first, first + table[p, COUNT]):
            if blocks[STILL, b]:
                _catch_up(octets, words, blocks, b)
        rest, sign = np.float64(s[REST]), np.float64(s[SIGN])
        for i in range(count):
            o = BLOCK * first + i
            last, zero = octets[LAST, o], offset[begin + i]
            own[SIGNAL, i], own[BEFORE, i] = signal_of(last, turn, s), signal_of(octets[EARLIER, o], turn, s)
            bytes_ = np.int64(words[SUM, o])
            total = 255 * frames - bytes_ if turn else bytes_
            own[TOTAL, i] += np.float32(sign * (total - frames * rest))
            high = abs(signal_of(octets[HIGH, o], turn, s) - zero)
            low = abs(signal_of(octets[LOW, o], turn, s) - zero)
            own[PEAK, i] = max(own[PEAK, i], high, low)
            own[BEND, i] += np.float32(words[BENDS, o])
            own[CHANGED, i] += np.float32(octets[CHANGES, o])
        here, there = BLOCK * first, BLOCK * (first + table[p, COUNT])
        words[SUM, here:there] = 0
        words[BENDS, here:there] = 0
        octets[CHANGES, here:there] = 0
        octets[LOW, here:there] = 255
        octets[HIGH, here:there] = 0
        state[p, SINCE] = 0
    if state[p, REPEATS]:
        repeats = np.float32(state[p, REPEATS])
        for i in range(count):
            signal = own[SIGNAL, i]
            own[BEND, i] += abs(own[BEFORE, i] - signal)
            own[BEFORE, i] = signal
            own[TOTAL, i] += repeats * signal
        for b in range(first, first + table[p, COUNT]):
            blocks[SETTLED, b] = 1
            for i in range(b * BLOCK, b * BLOCK + BLOCK):
                octets[EARLIER, i] = octets[LAST, i]
        state[p, REPEATS] = 0


TABLES = (reads(2, int64), reads(2, float32), reads(1, float32))
MEMORY = (writes(1, float32), writes(2, uint8), writes(2, uint16), writes(2, int32), writes(2))


@compiled(void(int64, *TABLES, *MEMORY))
def spill(
    p: int,
    table: Numbers,
    sensor: Single,
    offset: Single,
    memory: Single,
    octets: Octets,
    words: Words,
    blocks: NDArray[np.int32],
    state: Array,
) -> None:
    """Add what was counted of patch `p` to its `memory`, see `condition`, and begin to count anew."""
    add_up(p, table, sensor, offset, memory, octets, words, blocks, state)
