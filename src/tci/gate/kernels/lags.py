"""References as they were at earlier times, and by which time joints lag behind theirs. Used by
`tci.gate.contact.following`."""

from __future__ import annotations

import numpy as np
from numba import float64, intp, void
from numpy.typing import NDArray

from tci.messages.frames import Array
from tci.support.compiled import compiled, inlined, reads, views, writes


@inlined
def find_place(times: Array, time: float) -> int:
    """Number of `times` (n,), in ascending order, that are not after `time`."""
    low, high = 0, len(times)
    while low < high:
        middle = (low + high) // 2
        if times[middle] <= time:
            low = middle + 1
        else:
            high = middle
    return low


@inlined
def value_at(times: Array, rows: Array, place: int, time: float, column: int) -> float:
    """A column of `rows` (n, width) at `time`, of which `find_place` found the place: between two rows on a
    line."""
    before, after = max(place - 1, 0), min(place, len(times) - 1)
    value: float = rows[before, column]
    if after > before and time > times[before]:
        value += (time - times[before]) / (times[after] - times[before]) * (rows[after, column] - value)
    return value


@compiled(void(reads(1), reads(2), reads(1), writes(2)))
def rows_at(times: Array, rows: Array, wanted: Array, found: Array) -> None:
    """Writes `rows` (n, width) at the times `wanted` (k,) into `found` (k, width)."""
    for k in range(len(wanted)):
        place = find_place(times, wanted[k])
        for column in range(rows.shape[1]):
            found[k, column] = value_at(times, rows, place, wanted[k], column)


@compiled(void(reads(1), reads(2), float64, reads(1), views(1), float64, writes(1, intp), writes(1)))
def find_lags(
    times: Array, rows: Array, now: float, tried: Array, here: Array, fast: float,
    places: NDArray[np.intp], lags: Array,
) -> None:  # fmt: skip
    """Finds the shortest lag by which the reference of each joint was not ahead of where the joint is; the
    longest if it always was, or if it turned meanwhile. NaN if the reference has no value, or was slower than
    `fast` since then.

    Args:
        times: of the references (n,) [s].
        rows: references (n, width) [rad]; NaN for a joint that has none.
        now: time of the reading [s].
        tried: lags (k,) [s], ascending from 0.
        here: measured angles (width,) [rad].
        fast: [rad/s].
        places: room for k places.
        lags: the result (width,) [s].
    """
    for k in range(len(tried)):
        places[k] = find_place(times, now - tried[k])
    for joint in range(len(here)):
        lags[joint] = np.nan
        latest = value_at(times, rows, places[0], now - tried[0], joint)
        ahead, rises, falls, first = latest, True, True, len(tried) - 1
        for k in range(1, len(tried)):
            earlier = value_at(times, rows, places[k], now - tried[k], joint)
            rises, falls = rises and ahead >= earlier, falls and ahead <= earlier
            ahead = earlier
        way = 1.0 if rises else -1.0 if falls else np.nan
        for k in range(len(tried)):
            was = value_at(times, rows, places[k], now - tried[k], joint)
            if way * (here[joint] - was) >= 0.0:
                first = k
                break
        reached = max(first, 1)
        since = abs(latest - value_at(times, rows, places[reached], now - tried[reached], joint))
        if since > fast * tried[reached]:
            lags[joint] = tried[first]


@compiled(void(reads(1), reads(2), float64, float64, reads(1), reads(1), writes(1), writes(1)))
def find_span(
    times: Array, rows: Array, begin: float, now: float, tried: Array, longest: Array, low: Array, high: Array
) -> None:
    """Finds the least and the largest reference of each joint from `begin` to `now` [s], of these only what
    one of the lags `tried` leads to that is shorter than the joint's `longest`. NaN for a joint that had no
    reference meanwhile.

    Args:
        times: of the references (n,) [s].
        rows: references (n, width) [rad]; NaN for a joint that has none.
        begin: [s].
        now: [s].
        tried: lags (k,) [s]; with none of them every reference counts.
        longest: lag (width,) [s] of each joint.
        low: the result (width,) [rad].
        high: the result (width,) [rad].
    """
    first, end = max(find_place(times, begin) - 1, 0), find_place(times, now)
    for joint in range(rows.shape[1]):
        least = most = rows[first, joint]
        for k in range(first + 1, end):
            value = rows[k, joint]
            least = value if value < least or np.isnan(value) else least
            most = value if value > most or np.isnan(value) else most
        own_least, own_most = np.nan, np.nan
        for lag in tried:
            if lag < longest[joint]:
                value = value_at(times, rows, find_place(times, now - lag), now - lag, joint)
                own_least = own_least if value >= own_least or np.isnan(value) else value
                own_most = own_most if value <= own_most or np.isnan(value) else value
        if len(tried):
            least = own_least if least <= own_least or np.isnan(own_least) else least
            most = own_most if most >= own_most or np.isnan(own_most) else most
        low[joint], high[joint] = least, most
