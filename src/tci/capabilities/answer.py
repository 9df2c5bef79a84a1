"""Finds the receptive field of each contact, and the gain of the response from the contact's force and
distance (eqs 5-7), in a compiled loop."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import boolean, int64, void
from numpy.typing import NDArray

from tci.capabilities import discounts
from tci.capabilities.fields import ReceptiveField
from tci.messages import Contacts, Site
from tci.messages.frames import Array, read_only
from tci.robot.generic_arm import SEGMENTS
from tci.robot.limb import generic_limb_point
from tci.support.compiled import compiled, inlined, reads, record, views, writes

_SEGMENT, _X, _Y, _Z, _RADIUS, _THRESHOLD, _SATURATION, _MEASURE = range(8)
_MEASURES = ("weighted", "total", "peak")

_phi, _psi, _psi_cosine = [inlined(f) for f in (discounts.phi, discounts.psi, discounts.psi_cosine)]


def field_table(fields: Sequence[ReceptiveField]) -> Array:
    """Returns m fields as a table of numbers (8, m), in the format that `find_answers` reads."""
    rows = [
        (
            SEGMENTS.index(f.segment), *generic_limb_point(f.u, f.theta), f.radius, f.threshold, f.saturation,
            _MEASURES.index(f.measure),
        )
        for f in fields
    ]  # fmt: skip
    return read_only(np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(-1, 8).T))


class SiteNumbers(NamedTuple):
    """Generic part and segment of each of p patches, for the compiled loop."""

    part: tuple[str, ...]
    """Name of the generic part."""
    segment: NDArray[np.int64]
    """0 for the upper arm, 1 for the forearm, -1 if the site is on no segment of an arm."""
    merged: NDArray[np.int64]
    """Number (p,) that all sites of a part share, if several touches of this part in one field count as one.
    The number is -1 for sites of other parts."""
    limbs: tuple[str, ...]
    """Names of the parts that have skin on an upper arm or a forearm. Only on these parts can a field contain
    a contact."""


@lru_cache(maxsize=64)
def site_numbers(sites: tuple[Site, ...], merged: frozenset[str] = frozenset()) -> SiteNumbers:
    """Returns the properties of `sites` as numbers for the compiled loop.

    `merged` are the names of the parts on which all contacts in one field count as one: only the contact with
    the strongest response is used."""
    parts = tuple([site.part for site in sites])
    segments = [SEGMENTS.index(s.segment) if s.segment in SEGMENTS else -1 for s in sites]
    numbers = [parts.index(part) if part in merged else -1 for part in parts]
    limbs = dict.fromkeys(part for part, segment in zip(parts, segments, strict=True) if segment >= 0)
    return SiteNumbers(parts, read_only(segments, np.int64), read_only(numbers, np.int64), tuple(limbs))


class Touches(NamedTuple):
    """The arrays of `Contacts` on which the response of a receptive field depends."""

    site: NDArray[np.int64]
    begin: NDArray[np.int64]
    force: Array
    peak: Array
    limb_point: Array
    taxel_force: Array
    taxel_point: Array


def touches(contacts: Contacts) -> Touches:
    c = contacts
    return Touches(c.site, c.begin, c.force, c.peak, c.limb_point, c.taxel_force, c.taxel_point)


@inlined
def _felt(fields: Array, closest: int, contacts: Touches, c: int) -> float:
    """Returns the force [N] of contact `c` that is compared with the thresholds of a receptive field: the
    total force, the force on the strongest taxel, or the weighted force of eq. 7. The field's setting
    `measure` decides.

    `fields` is a table with one column for each field, and `closest` the column of this field.
    """
    if fields[_MEASURE, closest] == 1.0:
        return contacts.force[c]
    if fields[_MEASURE, closest] == 2.0:
        return contacts.peak[c]
    total, weights = 0.0, 0.0
    reach, points = 2.0 * fields[_RADIUS, closest], contacts.taxel_point
    u, y, z = contacts.limb_point[c, 0], contacts.limb_point[c, 1], contacts.limb_point[c, 2]
    for k in range(contacts.begin[c], contacts.begin[c + 1]):
        dx, dy, dz = points[k, 0] - u, points[k, 1] - y, points[k, 2] - z
        weight = reach - np.sqrt(dx * dx + dy * dy + dz * dz)
        if weight > 0.0:
            total += weight * contacts.taxel_force[k]
            weights += weight
    return total / weights if weights > 0.0 else 0.0


@inlined
def _squares(fields: Array, segment: float, u: float, y: float, z: float, squares: Array) -> None:
    """Writes into `squares` (m,) the squared distance of a contact from the centre of each of m receptive
    fields, in limb lengths.

    The value is infinite for a field that does not contain the contact. The contact is at the point (`u`,
    `y`, `z`) on the generic limb.
    """
    places, xs, ys, zs, radii = fields[_SEGMENT], fields[_X], fields[_Y], fields[_Z], fields[_RADIUS]
    for i in range(len(squares)):
        dx, dy, dz = xs[i] - u, ys[i] - y, zs[i] - z
        square = dx * dx + dy * dy + dz * dz
        inside = (square < radii[i] * radii[i]) & (places[i] == segment)
        squares[i] = square if inside else np.inf


_TOUCHES = record(Touches, views(1, int64), reads(1, int64), views(1), views(1), views(2), views(1), views(2))


@compiled(
    void(
        reads(2),
        boolean,
        reads(1, int64),
        reads(1, int64),
        _TOUCHES,
        writes(1, int64),
        writes(1),
        writes(1, int64),
        writes(1),
    )
)
def find_answers(
    fields: Array,
    cosine: bool,
    segments: NDArray[np.int64],
    merged: NDArray[np.int64],
    contacts: Touches,
    beside: NDArray[np.int64],
    squares: Array,
    nearest: NDArray[np.int64],
    gains: Array,
) -> None:
    """Finds for each contact the nearest field that contains the contact, and the gain phi(F) psi(d).

    Args: fields: Table (8, m) of the m fields, made by `field_table`. cosine: True to use `psi_cosine`
        instead of `psi`. segments: Index (p,) of the limb segment of each patch (site) in `SEGMENTS`; -1 for
        none. merged: Number (p,) of each patch's part, or -1. On a part with a number, several contacts in
        one field count as one. contacts: Arrays of c contacts. beside: Index (c,) of a field that is excluded
        for each contact; -1 for none. squares: Scratch array (m,). nearest: Output (c,): index of the nearest
        field; -1 if the contact lies in no field. gains: Output (c,): gain of this field, 0 to 1. If contacts
        count as one, only the largest of their gains is kept (of equal gains, the first); the other gains
        become 0.
    """
    for c in range(len(contacts.site)):
        point = contacts.limb_point[c]
        _squares(fields, np.float64(segments[contacts.site[c]]), point[0], point[1], point[2], squares)
        closest, least = -1, np.inf
        for i in range(len(squares)):
            if squares[i] < least and i != beside[c]:
                closest, least = i, squares[i]
        nearest[c], gains[c] = closest, 0.0
        if closest >= 0:
            radius, apart = fields[_RADIUS, closest], np.sqrt(least)
            felt = _felt(fields, closest, contacts, c)
            gain = _phi(felt, fields[_THRESHOLD, closest], fields[_SATURATION, closest])
            gains[c] = gain * (_psi_cosine(apart, radius) if cosine else _psi(apart, radius))
        part = merged[contacts.site[c]]
        for d in range(c if part >= 0 and gains[c] > 0.0 else 0):
            if gains[d] > 0.0 and nearest[d] == closest and merged[contacts.site[d]] == part:
                weaker = d if gains[c] > gains[d] else c
                gains[weaker] = 0.0
