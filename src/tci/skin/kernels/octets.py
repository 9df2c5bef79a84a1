"""One frame of all patches with 8-bit sensors: raw bytes to pressure, touching little more than the bytes.

Bytes are turned so that pressure raises them, and compared with the least byte that is felt; `octet_counts`
keeps what `condition` keeps of each taxel in single precision.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, float32, float64, int32, int64, uint8
from numpy.typing import NDArray

from tci.compiled import compiled, inlined, reads, writes
from tci.frames import Array
from tci.skin.kernels.condition import HIGHEST, LOWEST, Single, response
from tci.skin.kernels.octet_counts import (
    BEGIN,
    BENT,
    BLOCK,
    COUNT,
    DUE,
    ELAPSED,
    FIRST,
    FRAMES,
    IN_LESSON,
    LAST,
    LEAST,
    LIMIT,
    LIVE,
    LONGEST,
    MEMORY,
    NODE,
    NODES,
    NOW,
    REPEATS,
    SINCE,
    SOURCE,
    STAMP,
    STRAIGHT,
    TABLES,
    TAXELS,
    TURN,
    Numbers,
    Octets,
    Words,
    add_up,
    alive,
    signal_of,
    update,
)  # fmt: skip

_PIECE = 16


@inlined
def _all_can_be(raw: Octets, which: Numbers, table: Numbers, sensor: Single, channels: Numbers) -> bool:
    """Whether no byte of the frames is one that its sensor can't send."""
    for k in range(len(which)):
        p = which[k]
        if p < 0:
            continue
        source = table[p, SOURCE]
        lowest, highest = sensor[p, LOWEST], sensor[p, HIGHEST]
        if lowest > 0.0 or highest < 255.0:
            for i in range(table[p, BEGIN], table[p, BEGIN] + table[p, TAXELS]):
                value = np.float32(raw[source + channels[i]])
                if value < lowest or value > highest:
                    return False
    return True


@compiled(
    boolean(
        int64, reads(2, int64), reads(2, float32), reads(1, float32), reads(1, float32), reads(1, boolean),
        writes(2, uint8), writes(2, int32),
    )
)  # fmt: skip
def set_limits(
    p: int,
    table: Numbers,
    sensor: Single,
    offset: Single,
    threshold: Single,
    silent: NDArray[np.bool_],
    octets: Octets,
    blocks: NDArray[np.int32],
) -> bool:
    """The largest byte of each taxel (n,) of patch `p` that is not felt, as `condition` decides; false where
    every byte would be."""
    begin, first, turn = table[p, BEGIN], table[p, FIRST], np.uint8(table[p, TURN])
    whole = True
    for i in range(table[p, TAXELS]):
        least, most = 0, 256
        zero = offset[begin + i]
        while least < most:
            middle = (least + most) // 2
            deviation = signal_of(np.uint8(middle), turn, sensor[p]) - zero
            if deviation > np.float32(0.0) and deviation >= threshold[i]:
                most = middle
            else:
                least = middle + 1
        if silent[i]:
            least = 256
        whole &= least > 0
        octets[LIMIT, BLOCK * first + i] = max(least - 1, 0)
    for b in range(first, first + table[p, COUNT]):
        blocks[LIVE, b] = alive(octets, LAST, b)
    return whole


@compiled(
    int64(
        reads(1, uint8), reads(1, int64), reads(1), float64, *TABLES, *MEMORY, reads(1, int64), reads(1),
        reads(2), reads(1), writes(1), writes(1, int32), writes(1), writes(1, int64), writes(1, int32),
        writes(1), writes(1, int64),
    ),
)  # fmt: skip
def feel(
    raw: Octets,
    which: Numbers,
    stamps: Array,
    gap: float,
    table: Numbers,
    sensor: Single,
    offset: Single,
    memory: Single,
    octets: Octets,
    words: Words,
    blocks: NDArray[np.int32],
    state: Array,
    channels: Numbers,
    gain: Array,
    nodes: Array,
    area: Array,
    force: Array,
    active: NDArray[np.int32],
    felt: Array,
    counts: Numbers,
    taxels: NDArray[np.int32],
    pressure: Array,
    ends: Numbers,
) -> int:
    """New frames of some patches: what is felt, and where; for how many of them a lesson is due; -1, and
    nothing is done, where one has a byte that its sensor can't send.

    `raw` (channels of all patches,) with these frames in their places; `which` (k,) patch each is of, or -1 -
    p where it is the same as the one before, which is not looked at; `stamps` (k,) [s], NaN for none; `gap`
    [s] the longest time that counts as passed between two frames. Tables and memory of all patches, see
    above: `sensor` (p, 5), `offset` (n,), `memory` (ROWS n,); `channels`, `gain`, `area` (n,). Written are
    the `force` (n,) [N] on each taxel, the `active` taxels (n,) of each patch, the pressure `felt` (n,) [Pa]
    by each of them and their `counts` (p,); and, one patch after the other, `taxels` and `pressure` (n,) of
    these, and where each patch's `ends` (p + 1,).
    """
    if not _all_can_be(raw, which, table, sensor, channels):
        return -1
    due = 0
    for k in range(len(which)):
        again = which[k] < 0
        p = -1 - which[k] if again else which[k]
        begin, count, first, turn = (
            table[p, BEGIN],
            table[p, TAXELS],
            table[p, FIRST],
            np.uint8(table[p, TURN]),
        )
        if not np.isnan(stamps[k]):
            if not np.isnan(state[p, STAMP]):
                state[p, ELAPSED] += min(max(stamps[k] - state[p, STAMP], 0.0), gap)
            state[p, STAMP] = stamps[k]
        if again:
            state[p, REPEATS] += 1
        else:
            if state[p, REPEATS] or state[p, SINCE] >= LONGEST:
                add_up(p, table, sensor, offset, memory, octets, words, blocks, state)
            now = octets[NOW]
            start, source = BLOCK * first, table[p, SOURCE]
            if table[p, STRAIGHT]:
                for i in range(np.uint64(count)):
                    now[np.uint64(start) + i] = raw[np.uint64(source) + i] ^ turn
            else:
                for i in range(np.uint64(count)):
                    now[np.uint64(start) + i] = raw[source + channels[np.uint64(begin) + i]] ^ turn
            update(p, table, octets, words, blocks, state)
            for j in range(begin, begin + counts[p]):
                force[begin + active[j]] = 0.0
            place, limit, s = begin, octets[LIMIT], sensor[p]
            node, nodes_n = table[p, NODE], table[p, NODES]
            for b in range(first, first + table[p, COUNT]):
                if not blocks[LIVE, b]:
                    continue
                for piece in range(b * BLOCK, b * BLOCK + BLOCK, _PIECE):
                    some = np.uint8(0)
                    for o in range(np.uint64(piece), np.uint64(piece + _PIECE)):
                        some |= np.uint8(now[o] > limit[o])
                    if some == 0:
                        continue
                    for o in range(piece, piece + _PIECE):
                        if now[o] <= limit[o]:
                            continue
                        i = o - start
                        deviation = float(signal_of(now[o], turn, s) - offset[begin + i])
                        if nodes_n:
                            deviation = response(deviation, nodes[:, node : node + nodes_n])
                        one = gain[begin + i] * deviation
                        active[place], felt[place] = i, one
                        place += 1
                        force[begin + i] = one * area[begin + i]
            counts[p] = place - begin
        state[p, BENT] += state[p, FRAMES] == 2.0
        state[p, FRAMES] = min(state[p, FRAMES] + 1.0, 2.0)
        state[p, IN_LESSON] += 1.0
        due += state[p, ELAPSED] >= state[p, DUE] and state[p, IN_LESSON] >= state[p, LEAST]
    found = 0
    ends[0] = 0
    for p in range(len(counts)):
        for j in range(table[p, BEGIN], table[p, BEGIN] + counts[p]):
            taxels[found], pressure[found] = active[j], felt[j]
            found += 1
        ends[p + 1] = found
    return due
