"""One frame of a whole skin: the loops for one patch, called for all patches without going back to Python."""

from __future__ import annotations

import numpy as np
from numba import float64, int32, int64, void

from tci.compiled import compiled, inlined, reads, returns, views, writes
from tci.frames import Array
from tci.skin.kernels.contacts import FORCE, THETA, U, cluster, cluster_of, describe
from tci.skin.kernels.flat import Indices

TAXEL, GRAPH, FACE, CELL = range(4)
"""Columns of `begins`: where each of a patch's arrays begins in those of the skin."""
LINK, LIMB_LINK, POSTURE = range(3)
"""Columns of `on`: place of the patch's link, of its segment's link and of its part's posture."""
PATCH, IDENTITY, BEGAN, SEEN, ORIGIN, PLACE, TRACK = 0, 1, 2, 3, 4, 7, 10
"""Columns of a track, and their number: the patch, the contact's number, when it began and was seen last [s],
where it began and is (3,) [m]."""


@inlined
def _before(numbers: Array, one: int, other: int) -> bool:
    for column, sign in ((FORCE, -1.0), (U, 1.0), (THETA, 1.0)):
        a, b = sign * numbers[one, column], sign * numbers[other, column]
        if a != b:
            return a < b
    return False


@inlined
def _apart(one: Array, other: Array) -> float:
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return np.sqrt(x * x + y * y + z * z)


@compiled(
    returns(int64, int64, int64)(
        reads(1),
        float64,
        float64,
        reads(1, int32),
        reads(1, int64),
        reads(1, int32),
        reads(2, int64),
        writes(1, int32),
        writes(1, int64),
    )
)
def cluster_all(
    force: Array,
    floor: float,
    touch: float,
    active: Indices,
    actives: Indices,
    graph: Indices,
    begins: Indices,
    work: Indices,
    counts: Indices,
) -> tuple[int, int, int]:
    """`cluster` on every patch: the number of contacts, of their taxels, and of those of a single taxel;
    `counts` (p,) of each patch.

    `active` taxels (n,) of each patch, and how many (p,) they are, -1 where nobody knows; `begins` (p + 1, 4)
    see above; `work` (4 n + p,) is memory that is zero before the first call.
    """
    contacts, taxels, lone = 0, 0, 0
    for p in range(len(counts)):
        a, b = begins[p, TAXEL], begins[p + 1, TAXEL]
        own = work[4 * a + p : 4 * b + p + 1]
        edges = graph[begins[p, GRAPH] : begins[p + 1, GRAPH]]
        if actives[p] < 0:
            counts[p] = cluster(force[a:b], floor, touch, edges, own)
        else:
            counts[p] = cluster_of(force[a:b], floor, touch, active[a : a + actives[p]], edges, own)
        contacts += counts[p]
        taxels += own[b - a + counts[p]] if counts[p] else 0
        for i in range(b - a, b - a + counts[p]):
            lone += own[i + 1] - own[i] == 1
    return contacts, taxels, lone


@compiled(
    void(
        reads(1), reads(1, int32), reads(2, int64), reads(1, int64), reads(2), reads(2, int32), reads(2),
        reads(1, int32), reads(2), reads(3), reads(2), reads(2, int64), writes(2), writes(3),
        writes(1, int64), writes(2), writes(2, int64),
    ),
)  # fmt: skip
def describe_all(
    force: Array,
    work: Indices,
    begins: Indices,
    counts: Indices,
    taxels: Array,
    faces: Indices,
    box: Array,
    cells: Indices,
    limb: Array,
    poses: Array,
    posture: Array,
    on: Indices,
    numbers: Array,
    vectors: Array,
    indices: Indices,
    places: Array,
    rows: Indices,
) -> None:
    """`describe` on every patch that has contacts; `rows` (3, c + 1): where each one's taxels begin, its
    patch, and which one comes at this place of the order, the strongest of each patch first."""
    c = begin = 0
    rows[0, 0] = 0
    for p in range(len(counts)):
        count = counts[p]
        if count == 0:
            continue
        a, b = begins[p, TAXEL], begins[p + 1, TAXEL]
        own = work[4 * a + p : 4 * b + p + 1]
        bounds = own[b - a :]
        describe(
            force[a:b], own, taxels[a:b], faces[begins[p, FACE] : begins[p + 1, FACE]], box[p],
            cells[begins[p, CELL] : begins[p + 1, CELL]], poses[on[p, LINK]], poses[on[p, LIMB_LINK]],
            limb[p], posture[on[p, POSTURE]], count, c, begin, numbers, vectors, indices, places,
        )  # fmt: skip
        for i in range(count):
            rows[0, c + i + 1] = begin + bounds[i + 1]
            rows[1, c + i] = p
            k = c + i
            while k > c and _before(numbers, c + i, rows[2, k - 1]):
                rows[2, k] = rows[2, k - 1]
                k -= 1
            rows[2, k] = c + i
        c += count
        begin += bounds[count]


@inlined
def _is_among(number: float, told: Array, begin: int, end: int) -> bool:
    among = False
    for c in range(begin, end):
        among |= told[c, 0] == number
    return among


@inlined
def _nearest_free(
    now: int,
    tracks: Array,
    known: int,
    p: int,
    centres: Array,
    reach: float,
    told: Array,
    begin: int,
    end: int,
) -> tuple[int, float]:
    """Of the tracks of patch `p` that none of its contacts from `begin` to `end` is, the one that is nearest
    to the contact `now`, and its distance [m]; -1 for none within `reach` [m]."""
    nearest, least = -1, np.inf
    for i in range(known):
        if int(tracks[i, PATCH]) == p:
            far = _apart(centres[now], tracks[i, PLACE : PLACE + 3])
            if far <= reach and far < least and not _is_among(tracks[i, IDENTITY], told, begin, end):
                nearest, least = i, far
    return nearest, least


@compiled(
    returns(int64, int64)(
        reads(2), views(2), views(1, int64), views(1), float64, float64, int64, writes(2), writes(2)
    )
)
def follow_all(
    old: Array,
    centres: Array,
    patches: Indices,
    stamps: Array,
    reach: float,
    linger: float,
    fresh: int,
    tracks: Array,
    told: Array,
) -> tuple[int, int]:
    """Which contact is which: the next number that is free, and how many of the `tracks` are in use.

    `old` (t, TRACK) tracks; contacts at `centres` (c, 3) [m], of `patches` (c,) that rise, seen at `stamps`
    (p,) [s] of each patch. Contacts of a patch and its tracks seen within `linger` [s] are the same
    where they are the nearest pairs, within `reach` [m]; the rest are new, numbered from `fresh` on. Written
    are `tracks` (t + c, TRACK) and what is `told` (c, 3) of each: number, begin [s], distance [m] from there.
    """
    used, contacts = 0, len(patches)
    for i in range(len(old)):  # of patches without contacts, tracks wait for their next one
        p = int(old[i, PATCH])
        felt = False
        for c in range(contacts):
            felt |= patches[c] == p
        if not felt or stamps[p] - old[i, SEEN] <= linger:
            for column in range(TRACK):
                tracks[used, column] = old[i, column]
            used += 1
    begin, known = 0, used
    while begin < contacts:
        p = patches[begin]
        end = begin
        while end < contacts and patches[end] == p:
            told[end, 0] = 0.0
            end += 1
        for c in range(begin, end):  # the track that it may be, and how far that is
            told[c, 1], told[c, 2] = _nearest_free(c, tracks, known, p, centres, reach, told, begin, end)
        while True:
            now, least = -1, np.inf
            for c in range(begin, end):
                if told[c, 0] == 0.0 and told[c, 2] < least:
                    now, least = c, told[c, 2]
            if now < 0:
                break
            i = int(told[now, 1])
            if _is_among(tracks[i, IDENTITY], told, begin, end):  # a nearer contact is that one
                told[now, 1], told[now, 2] = _nearest_free(
                    now, tracks, known, p, centres, reach, told, begin, end
                )
                continue
            tracks[i, SEEN] = stamps[p]
            told[now, 0] = tracks[i, IDENTITY]
            told[now, 1] = tracks[i, BEGAN]
            told[now, 2] = _apart(centres[now], tracks[i, ORIGIN : ORIGIN + 3])
            for axis in range(3):
                tracks[i, PLACE + axis] = centres[now, axis]
        for now in range(begin, end):
            if told[now, 0] == 0.0:
                tracks[used, PATCH], tracks[used, IDENTITY] = p, fresh
                tracks[used, BEGAN] = tracks[used, SEEN] = stamps[p]
                for axis in range(3):
                    tracks[used, ORIGIN + axis] = tracks[used, PLACE + axis] = centres[now, axis]
                told[now, 0], told[now, 1], told[now, 2] = fresh, stamps[p], 0.0
                used += 1
                fresh += 1
        begin = end
    return fresh, used
