"""Which receptive field answers a contact, and with which gain (eqs 5-7): one function per equation, for all
contacts in one compiled loop."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numba import boolean, from_dtype, int64, void
from numpy.typing import NDArray

from tci.capabilities import discounts
from tci.capabilities.fields import ReceptiveField
from tci.messages import Site
from tci.messages.contacts import CONTACT, TAXEL
from tci.messages.frames import Array, read_only
from tci.robot.generic_arm import SEGMENTS
from tci.robot.limb import generic_limb_point
from tci.support.compiled import compiled, inlined, reads, writes

MEASURES = ("weighted", "total", "peak")
FIELD = np.dtype(
    [
        ("segment", np.int64),
        ("x", np.float64),
        ("y", np.float64),
        ("z", np.float64),
        ("radius", np.float64),
        ("threshold", np.float64),
        ("saturation", np.float64),
        ("measure", np.int64),
    ]
)
"""A `ReceptiveField` for the compiled loop: the numbers of its segment in SEGMENTS and of its measure in
MEASURES, and its centre on the generic limb [limb lengths]."""
RANKS = 3
"""A contact asks for the nearest field, and for the two nearest wide fields."""

_phi, _psi, _psi_cosine = [inlined(f) for f in (discounts.phi, discounts.psi, discounts.psi_cosine)]
_NUMBERS = {segment: number for number, segment in enumerate(SEGMENTS)}
_WEIGHTED, _TOTAL = MEASURES.index("weighted"), MEASURES.index("total")


def field_table(fields: Sequence[ReceptiveField]) -> NDArray[np.void]:
    """The fields (m,) of the type FIELD."""
    rows = [
        (
            SEGMENTS.index(f.segment), *generic_limb_point(f.u, f.theta), f.radius, f.threshold, f.saturation,
            MEASURES.index(f.measure),
        )
        for f in fields
    ]  # fmt: skip
    return read_only(rows, FIELD)


def segments_of(sites: Iterable[Site]) -> NDArray[np.int64]:
    """Number (c,) in SEGMENTS of the segment of each of c sites; -1 for none."""
    return np.array([_NUMBERS.get(site.segment, -1) for site in sites], np.int64)


@inlined
def _distance(field: Any, contact: Any) -> float:
    """Distance d [limb lengths] of a contact from the centre of a field on the generic limb (eq. 6)."""
    p = contact.limb_point
    x, y, z = p[0] - field.x, p[1] - field.y, p[2] - field.z
    return np.sqrt(x * x + y * y + z * z)


@inlined
def _weighted_force(field: Any, contact: Any, taxels: Any, first: int, end: int) -> float:
    """Force F [N] of a contact: the mean over its taxels, weighted by 2 r - d (eq. 7)."""
    total, weights, p = 0.0, 0.0, contact.limb_point
    for k in range(first, end):
        q = taxels[k].taxel_point
        x, y, z = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        weight = 2.0 * field.radius - np.sqrt(x * x + y * y + z * z)
        if weight > 0.0:
            total += weight * taxels[k].taxel_force
            weights += weight
    return total / weights if weights > 0.0 else 0.0


@inlined
def _gain(field: Any, contact: Any, taxels: Any, first: int, end: int, cosine: bool) -> float:
    """Gain phi(F) psi(d) of the answer to a contact (eq. 5)."""
    if field.measure == _WEIGHTED:
        force = _weighted_force(field, contact, taxels, first, end)
    elif field.measure == _TOTAL:
        force = contact.force
    else:
        force = contact.peak
    d = _distance(field, contact)
    near = _psi_cosine(d, field.radius) if cosine else _psi(d, field.radius)
    return _phi(force, field.threshold, field.saturation) * near


@inlined
def _nearest(fields: Any, contact: Any, segment: int, beside: int) -> int:
    """Index of the field with the nearest centre that contains a contact; -1 for none. The field `beside` is
    left out."""
    found, least = -1, np.inf
    for i in range(len(fields)):
        if fields[i].segment == segment and i != beside:
            distance = _distance(fields[i], contact)
            if distance < fields[i].radius and distance < least:
                found, least = i, distance
    return found


_FIELDS = reads(1, from_dtype(FIELD))


@compiled(
    void(
        _FIELDS, _FIELDS, boolean, reads(1, int64), reads(1, from_dtype(CONTACT)), reads(1, int64),
        reads(1, from_dtype(TAXEL)), writes(2, int64), writes(2),
    )
)  # fmt: skip
def find_answers(
    fields: NDArray[np.void],
    surround: NDArray[np.void],
    cosine: bool,
    segments: NDArray[np.int64],
    contacts: NDArray[np.void],
    begin: NDArray[np.int64],
    taxels: NDArray[np.void],
    nearest: NDArray[np.int64],
    gains: Array,
) -> None:
    """Finds the field that answers each of c contacts, and two wide fields to try after it.

    Args:
        fields: Fields, of the type FIELD.
        surround: Wide fields.
        cosine: True for `psi_cosine` instead of `psi`.
        segments: Number (c,) of the limb segment of each contact; -1 for none.
        contacts: `Contacts.rows`.
        begin: `Contacts.begin`.
        taxels: `Contacts.taxel_rows`.
        nearest: Output (3, c): index of the nearest field, of the nearest wide field, and of the second
            nearest; -1 for none.
        gains: Output (3, c): gain of each, 0 to 1.
    """
    for rank in range(RANKS):
        own = fields if rank == 0 else surround
        for c in range(len(contacts)):
            found = _nearest(own, contacts[c], segments[c], nearest[1, c] if rank == 2 else -1)
            nearest[rank, c], gains[rank, c] = found, 0.0
            if found >= 0:
                gains[rank, c] = _gain(own[found], contacts[c], taxels, begin[c], begin[c + 1], cosine)
