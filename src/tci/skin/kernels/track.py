"""Gives each contact an identity, in compiled loops.

The identity stays constant from the contact's first frame to its last.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64

from tci.messages.frames import Array
from tci.skin.kernels.arrays import CONTACTS, ContactArrays
from tci.support.compiled import compiled, inlined, reads, returns, writes

PATCH, IDENTITY, BEGAN, SEEN, ORIGIN, PLACE, TRACK = 0, 1, 2, 3, 4, 7, 10
"""Columns of a table with a row for each track, which is the history of one contact: index of the patch,
identity of the contact, onset [s], time [s] of the latest frame with the contact, place [m] at onset (3
columns), and present place [m] (3 columns). `TRACK` is the number of columns."""
_FREE = -1


@inlined
def _distance(one: Array, other: Array) -> float:
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    distance: float = np.sqrt(x * x + y * y + z * z)
    return distance


@inlined
def _is_taken(track: int, best: Array, begin: int, end: int) -> bool:
    taken = False
    for c in range(begin, end):
        taken |= best[c, 0] == 1.0 and int(best[c, 1]) == track
    return taken


@inlined
def _find_nearest(
    c: int, tracks: Array, known: int, reach: float, out: ContactArrays, best: Array, begin: int, end: int
) -> None:
    """Finds the nearest track (history of an earlier contact) to contact `c`, among the tracks of the patch
    that have no contact in this frame yet.

    Writes the track's index, and its distance [m] from the contact, into columns 1 and 2 of `best[c]`: -1 and
    infinity if there is no such track within `reach` [m].
    """
    best[c, 1], best[c, 2] = _FREE, np.inf
    for i in range(known):
        if int(tracks[i, PATCH]) == out.rows.site[c]:
            far = _distance(out.rows.p_L[c], tracks[i, PLACE : PLACE + 3])
            if far <= reach and far < best[c, 2] and not _is_taken(i, best, begin, end):
                best[c, 1], best[c, 2] = i, far


@inlined
def _assign(
    tracks: Array, known: int, reach: float, out: ContactArrays, best: Array, begin: int, end: int
) -> None:
    """Assigns the contacts of one patch (indices from `begin` to `end` - 1) to the patch's tracks (histories
    of earlier contacts), the nearest pair first.

    The result is in `best`: column 0 is 1 for a contact with a track, otherwise 0, and column 1 is the index
    of this track in `tracks`.
    """
    for c in range(begin, end):
        best[c, 0] = 0.0
    for c in range(begin, end):
        _find_nearest(c, tracks, known, reach, out, best, begin, end)
    while True:
        now, least = -1, np.inf
        for c in range(begin, end):
            if best[c, 0] == 0.0 and best[c, 2] < least:
                now, least = c, best[c, 2]
        if now < 0:
            break
        if _is_taken(int(best[now, 1]), best, begin, end):  # a nearer contact has it
            _find_nearest(now, tracks, known, reach, out, best, begin, end)
        else:
            best[now, 0] = 1.0


@inlined
def _first_new(out: ContactArrays, best: Array, begin: int, end: int) -> int:
    """Returns the index of the contact that gets the next new identity: of the contacts from `begin` to `end`
    - 1 that continue no earlier contact, the contact whose first taxel has the lowest index.

    Returns -1 if there is no such contact.
    """
    first = -1
    for c in range(begin, end):
        if best[c, 0] == 0.0 and (
            first < 0 or out.taxels.taxel[out.begin[c]] < out.taxels.taxel[out.begin[first]]
        ):
            first = c
    return first


@compiled(returns(int64, int64)(reads(2), reads(1), float64, float64, int64, writes(2), writes(2), CONTACTS))
def track(
    old: Array,
    stamps: Array,
    reach: float,
    linger: float,
    fresh: int,
    tracks: Array,
    best: Array,
    out: ContactArrays,
) -> tuple[int, int]:
    """Writes identity, onset and displacement of each contact into `out`.

    A contact gets the identity of the nearest track (history of an earlier contact) of its patch, if the
    distance is at most `reach` [m]; the nearest pairs are matched first. Tracks of a touched patch are used
    only if they were seen within the last `linger` [s]. Other contacts are new and are numbered from `fresh`
    on. `old` (t, 10) are the previous tracks, and `stamps` (p,) [s] the times of the patches' frames. The new
    tracks are written to `tracks` (t + c, 10). `best` (c, 3) is work space. Returns the next free identity
    and the number of rows in use in `tracks`.
    """
    used, contacts, begin = 0, len(out.rows), 0
    for i in range(len(old)):  # tracks of patches without contacts wait for the next one
        p = int(old[i, PATCH])
        touched = False
        for c in range(contacts):
            touched |= out.rows.site[c] == p
        if not touched or stamps[p] - old[i, SEEN] <= linger:
            for column in range(TRACK):
                tracks[used, column] = old[i, column]
            used += 1
    known = used
    while begin < contacts:
        p, end = out.rows.site[begin], begin
        while end < contacts and out.rows.site[end] == p:
            end += 1
        _assign(tracks, known, reach, out, best, begin, end)
        while True:
            new = _first_new(out, best, begin, end)
            if new < 0:
                break
            best[new, 0], best[new, 1] = 1.0, used
            tracks[used, PATCH], tracks[used, IDENTITY], tracks[used, BEGAN] = p, fresh, stamps[p]
            for axis in range(3):
                tracks[used, ORIGIN + axis] = out.rows.p_L[new, axis]
            used += 1
            fresh += 1
        for c in range(begin, end):
            own = tracks[int(best[c, 1])]
            own[SEEN] = stamps[p]
            for axis in range(3):
                own[PLACE + axis] = out.rows.p_L[c, axis]
            out.rows.identity[c], out.rows.onset[c] = int(own[IDENTITY]), own[BEGAN]
            out.rows.displacement[c] = _distance(out.rows.p_L[c], own[ORIGIN:PLACE])
        begin = end
    return fresh, used
