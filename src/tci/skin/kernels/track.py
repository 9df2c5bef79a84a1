"""Gives each contact an identity, in compiled loops.

The identity stays constant from the contact's first frame to its last.
"""

from __future__ import annotations

import numpy as np
from numba import float64, from_dtype, int64

from tci.messages.frames import Array
from tci.skin.kernels.arrays import CONTACTS, ContactArrays, Records
from tci.support.compiled import compiled, inlined, reads, returns, writes

TRACK = np.dtype(
    [
        ("patch", np.int64), ("identity", np.int64), ("onset", np.float64), ("seen", np.float64),
        ("origin", np.float64, (3,)), ("place", np.float64, (3,)),
    ],
    align=True,
)  # fmt: skip
"""History of one contact: index of its patch, identity, onset [s], time [s] of the latest frame with it,
place [m] at the onset, and latest place [m]."""
MATCH = np.dtype([("matched", np.bool_), ("number", np.int64), ("far", np.float64)], align=True)
"""Track of one contact: True if it is decided, its index, and its distance [m] from the contact."""
_FREE = -1


@inlined
def _distance(one: Array, other: Array) -> float:
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    distance: float = np.sqrt(x * x + y * y + z * z)
    return distance


@inlined
def _is_taken(track: int, best: Records, begin: int, end: int) -> bool:
    taken = False
    for c in range(begin, end):
        taken |= best[c].matched and best[c].number == track
    return taken


@inlined
def _find_nearest(
    c: int, tracks: Records, known: int, reach: float, out: ContactArrays, best: Records, begin: int, end: int
) -> None:
    """Finds the nearest track (history of an earlier contact) to contact `c`, among the tracks of the patch
    that have no contact in this frame yet.

    Writes the track's index, and its distance [m] from the contact, into `best[c]`: -1 and infinity if there
    is no such track within `reach` [m].
    """
    own, place = best[c], out.rows[c].p_L
    own.number, own.far = _FREE, np.inf
    for i in range(known):
        if tracks[i].patch == out.rows[c].site:
            far = _distance(place, tracks[i].place)
            if far <= reach and far < own.far and not _is_taken(i, best, begin, end):
                own.number, own.far = i, far


@inlined
def _assign(
    tracks: Records, known: int, reach: float, out: ContactArrays, best: Records, begin: int, end: int
) -> None:
    """Assigns the contacts of one patch (indices from `begin` to `end` - 1) to the patch's tracks (histories
    of earlier contacts), the nearest pair first.

    The result is in `best`: whether a contact has a track, and the index of this track in `tracks`.
    """
    for c in range(begin, end):
        best[c].matched = False
    for c in range(begin, end):
        _find_nearest(c, tracks, known, reach, out, best, begin, end)
    while True:
        now, least = -1, np.inf
        for c in range(begin, end):
            if not best[c].matched and best[c].far < least:
                now, least = c, best[c].far
        if now < 0:
            break
        if _is_taken(best[now].number, best, begin, end):  # a nearer contact has it
            _find_nearest(now, tracks, known, reach, out, best, begin, end)
        else:
            best[now].matched = True


@inlined
def _lead(c: int, out: ContactArrays) -> int:
    return int(out.taxels[out.begin[c]].taxel)


@inlined
def _first_new(out: ContactArrays, best: Records, begin: int, end: int) -> int:
    """Returns the index of the contact that gets the next new identity: of the contacts from `begin` to `end`
    - 1 that continue no earlier contact, the contact whose first taxel has the lowest index.

    Returns -1 if there is no such contact.
    """
    first = -1
    for c in range(begin, end):
        if not best[c].matched and (first < 0 or _lead(c, out) < _lead(first, out)):
            first = c
    return first


_TRACKS = from_dtype(TRACK)


@compiled(
    returns(int64, int64)(
        reads(1, _TRACKS), reads(1), float64, float64, int64, writes(1, _TRACKS),
        writes(1, from_dtype(MATCH)), CONTACTS,
    )
)  # fmt: skip
def track(
    old: Records,
    stamps: Array,
    reach: float,
    linger: float,
    fresh: int,
    tracks: Records,
    best: Records,
    out: ContactArrays,
) -> tuple[int, int]:
    """Writes identity, onset and displacement of each contact into `out`.

    A contact gets the identity of the nearest track (history of an earlier contact) of its patch, if the
    distance is at most `reach` [m]; the nearest pairs are matched first. Tracks of a touched patch are used
    only if they were seen within the last `linger` [s]. Other contacts are new and are numbered from `fresh`
    on. `old` (t,) are the previous tracks, and `stamps` (p,) [s] the times of the patches' frames. The new
    tracks are written to `tracks` (t + c,). `best` (c,) is work space. Returns the next free identity and the
    number of records in use in `tracks`.
    """
    used, contacts, begin = 0, len(out.rows), 0
    for i in range(len(old)):  # tracks of patches without contacts wait for the next one
        p = old[i].patch
        touched = False
        for c in range(contacts):
            touched |= out.rows[c].site == p
        if not touched or stamps[p] - old[i].seen <= linger:
            tracks[used] = old[i]
            used += 1
    known = used
    while begin < contacts:
        p, end = out.rows[begin].site, begin
        while end < contacts and out.rows[end].site == p:
            end += 1
        _assign(tracks, known, reach, out, best, begin, end)
        while True:
            new = _first_new(out, best, begin, end)
            if new < 0:
                break
            best[new].matched, best[new].number = True, used
            one = tracks[used]
            one.patch, one.identity, one.onset = p, fresh, stamps[p]
            for axis in range(3):
                one.origin[axis] = out.rows[new].p_L[axis]
            used += 1
            fresh += 1
        for c in range(begin, end):
            own, contact = tracks[best[c].number], out.rows[c]
            own.seen = stamps[p]
            for axis in range(3):
                own.place[axis] = contact.p_L[axis]
            contact.identity, contact.onset = own.identity, own.onset
            contact.displacement = _distance(contact.p_L, own.origin)
        begin = end
    return fresh, used
