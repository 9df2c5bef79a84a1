"""Which motion answers a contact, and with which gain (eqs 5-7): one function per equation, for all contacts
in one compiled loop.

`find_answers` is the paper's rule: the nearest field answers. `blend` mixes all fields of a segment."""

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
from tci.robot.limb import RHO, generic_limb_point
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
LEAST = 0.5
"""A place at which no field has this weight gets no answer: every answer is at least half of a full one."""
SLACK = 0.1
"""Speed [limb lengths/rad] of the middle of the limb below which a motion loses its weight, since it mostly
turns the limb about itself. At half of it neighbouring taxels near an axis
differ by more than 6 degrees, at double 4 % more touches of upper arms are refused."""

_phi, _psi, _printed = [inlined(f) for f in (discounts.phi, discounts.psi, discounts.printed)]
Vector = tuple[float, float, float]
_FOREARM = SEGMENTS.index("forearm")
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
def _force(field: Any, contact: Any, taxels: Any, first: int, end: int) -> float:
    """Force [N] of a contact, by the measure of a field."""
    if field.measure == _WEIGHTED:
        return _weighted_force(field, contact, taxels, first, end)
    return contact.force if field.measure == _TOTAL else contact.peak


@inlined
def _nearest(fields: Any, contact: Any, segment: int) -> int:
    """Index of the field with the nearest centre that contains a contact; -1 for none."""
    found, least = -1, np.inf
    for i in range(len(fields)):
        if fields[i].segment == segment:
            distance = _distance(fields[i], contact)
            if distance < fields[i].radius and distance < least:
                found, least = i, distance
    return found


_FIELDS = reads(1, from_dtype(FIELD))
_CONTACTS = reads(1, int64), reads(1, from_dtype(CONTACT)), reads(1, int64), reads(1, from_dtype(TAXEL))


@compiled(void(_FIELDS, boolean, *_CONTACTS, writes(1, int64), writes(1)))
def find_answers(
    fields: NDArray[np.void],
    printed: bool,
    segments: NDArray[np.int64],
    contacts: NDArray[np.void],
    begin: NDArray[np.int64],
    taxels: NDArray[np.void],
    nearest: NDArray[np.int64],
    gains: Array,
) -> None:
    """The paper's rule: finds the field that answers each of c contacts.

    Args:
        fields: Fields, of the type FIELD.
        printed: True for eq. 5 as printed, False for eq. 5 as meant.
        segments: Number (c,) of the limb segment of each contact; -1 for none.
        contacts: `Contacts.rows`.
        begin: `Contacts.begin`.
        taxels: `Contacts.taxel_rows`.
        nearest: Output (c,): index of the nearest field; -1 for none.
        gains: Output (c,): gain of its base motion, 0 to 1.
    """
    for c in range(len(contacts)):
        nearest[c], gains[c] = _nearest(fields, contacts[c], segments[c]), 0.0
        if nearest[c] >= 0:
            field = fields[nearest[c]]
            force = _force(field, contacts[c], taxels, begin[c], begin[c + 1])
            d = _distance(field, contacts[c])
            if printed:
                gains[c] = _printed(force, field.threshold, field.saturation, d, field.radius)
            else:
                gains[c] = _phi(force, field.threshold, field.saturation) * _psi(d, field.radius)


@inlined
def _moved(axis: Vector, r: Vector, x: Vector, y: Vector) -> tuple[float, float]:
    """Velocity of a point at `r` from an axis, along x and y."""
    a = axis[1] * r[2] - axis[2] * r[1]
    b = axis[2] * r[0] - axis[0] * r[2]
    c = axis[0] * r[1] - axis[1] * r[0]
    return a * x[0] + b * x[1] + c * x[2], a * y[0] + b * y[1] + c * y[2]


@inlined
def _speeds(postures: Array, c: int, segment: int, u: float, out: Array) -> None:
    """Writes the velocity (4, 2) [limb lengths/rad] of the middle of a limb at `u`, for each of four generic
    joints: towards the flexor and the lateral side. Both segments of this arm have the length 1; on the other
    side of the body the numbers are the same."""
    q0, q1, q2, q3 = postures[c, 0], postures[c, 1], postures[c, 2], postures[c, 3]
    c0, c1, c2, c3 = np.cos(q0), np.cos(q1), np.cos(q2), np.cos(q3)
    s0, s1, s2, s3 = np.sin(q0), np.sin(q1), np.sin(q2), np.sin(q3)
    x, y, z = (c0, 0.0, s0), (-s0 * s1, c1, c0 * s1), (-s0 * c1, -s1, c0 * c1)
    abduction, rotation = x, (-z[0], -z[1], -z[2])
    r = -u * z[0], -u * z[1], -u * z[2]
    beyond = r
    elbow = (0.0, 0.0, 0.0)
    if segment == _FOREARM:
        ahead = c2 * x[0] - s2 * y[0], c2 * x[1] - s2 * y[1], c2 * x[2] - s2 * y[2]
        y = s2 * x[0] + c2 * y[0], s2 * x[1] + c2 * y[1], s2 * x[2] + c2 * y[2]
        elbow = -y[0], -y[1], -y[2]
        x = c3 * ahead[0] + s3 * z[0], c3 * ahead[1] + s3 * z[1], c3 * ahead[2] + s3 * z[2]
        along = c3 * z[0] - s3 * ahead[0], c3 * z[1] - s3 * ahead[1], c3 * z[2] - s3 * ahead[2]
        beyond = -u * along[0], -u * along[1], -u * along[2]
        r = beyond[0] - z[0], beyond[1] - z[1], beyond[2] - z[2]
    out[0, 0], out[0, 1] = _moved((0.0, -1.0, 0.0), r, x, y)
    out[1, 0], out[1, 1] = _moved(abduction, r, x, y)
    out[2, 0], out[2, 1] = _moved(rotation, r, x, y)
    out[3, 0], out[3, 1] = _moved(elbow, beyond, x, y)


@inlined
def _directness(motions: Array, i: int, speeds: Array, away_x: float, away_y: float) -> float:
    """Cosine of the angle between the way of the limb's middle and the way out of the touch; 0 for a motion
    towards it."""
    x, y, size = 0.0, 0.0, 0.0
    for j in range(len(speeds)):
        x += motions[i, j] * speeds[j, 0]
        y += motions[i, j] * speeds[j, 1]
        size += motions[i, j] * motions[i, j]
    out = x * away_x + y * away_y
    return out / np.sqrt(x * x + y * y + SLACK * SLACK * size) if out > 0.0 else 0.0


@inlined
def _mix(weights: Array, motions: Array, mixed: Array) -> None:
    for j in range(motions.shape[1]):
        total, moved = 0.0, 0.0
        for i in range(len(motions)):
            if motions[i, j] != 0.0:
                total += weights[i]
                moved += weights[i] * motions[i, j]
        mixed[j] = moved / max(total, 1.0)


@compiled(void(reads(1), reads(2), writes(1)))
def mix(weights: Array, motions: Array, mixed: Array) -> None:
    """Writes the blend (n,) [rad] of base `motions` (m, n) with `weights` (m,), 0 to 1, into `mixed`.

    For each joint the weights of the motions that move it are at most 1 in total, so no joint goes beyond its
    base motions.
    """
    _mix(weights, motions, mixed)


@compiled(void(_FIELDS, reads(2), *_CONTACTS, reads(2), writes(2), writes(2), writes(1)))
def blend(
    fields: NDArray[np.void],
    motions: Array,
    segments: NDArray[np.int64],
    contacts: NDArray[np.void],
    begin: NDArray[np.int64],
    taxels: NDArray[np.void],
    postures: Array,
    room: Array,
    blends: Array,
    gains: Array,
) -> None:
    """Mixes the base motions of all fields of the touched segment, for each of c contacts.

    A field's weight is how directly its motion takes the middle of the limb away from the touch, times its
    nearness: 1 up to half its radius, 0 from the edge on. `mix` has the rest.

    Args:
        fields: m fields, of the type FIELD.
        motions: Base motions (m, 5) [rad].
        segments: Number (c,) of the limb segment of each contact; -1 for none.
        contacts: `Contacts.rows`.
        begin: `Contacts.begin`.
        taxels: `Contacts.taxel_rows`.
        postures: Generic angles (c, 5) [rad] of the touched arm.
        room: Room (m or 4, 3), whichever is more: for the weights, and beside them the speeds of the joints.
        blends: Output (c, 5): the mixed motion [rad]; 0 where no field has the weight LEAST.
        gains: Output (c,): phi(F) of the field with the largest weight, 0 to 1; 0 without a field.
    """
    weights, speeds = room[:, 0], room[:4, 1:]
    for c in range(len(contacts)):
        gains[c] = 0.0
        for j in range(motions.shape[1]):
            blends[c, j] = 0.0
        p = contacts[c].limb_point
        _speeds(postures, c, segments[c], p[0], speeds)
        most, first = 0.0, -1
        for i in range(len(fields)):
            weights[i] = 0.0
            if fields[i].segment == segments[c]:
                near = min(2.0 * _psi(_distance(fields[i], contacts[c]), fields[i].radius), 1.0)
                weights[i] = near * _directness(motions, i, speeds, -p[2] / RHO, -p[1] / RHO)
                if near > 0.0 and (first < 0 or weights[i] > most):
                    most, first = weights[i], i
        if first < 0:
            continue
        force = _force(fields[first], contacts[c], taxels, begin[c], begin[c + 1])
        gains[c] = _phi(force, fields[first].threshold, fields[first].saturation)
        if most < LEAST:
            continue
        _mix(weights, motions, blends[c])
