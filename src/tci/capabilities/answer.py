"""The force-distance model (eqs 5-7) for all contacts and all fields, compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import boolean, int64, void
from numpy.typing import NDArray

from tci.capabilities import discounts
from tci.capabilities.fields import ReceptiveField
from tci.compiled import compiled, inlined, reads, views, writes
from tci.frames import Array, read_only
from tci.robot.generic_arm import SEGMENTS
from tci.robot.limb import generic_limb_point
from tci.skin.kernels.contacts import FORCE, PEAK, U, Y, Z

_SEGMENT, _X, _Y, _Z, _RADIUS, _THRESHOLD, _SATURATION, _MEASURE = range(8)
_MEASURES = ("weighted", "sum", "peak")

_phi, _psi, _psi_cosine = [inlined(f) for f in (discounts.phi, discounts.psi, discounts.psi_cosine)]


def field_table(fields: Sequence[ReceptiveField]) -> Array:
    """The fields in numbers (8, m), as `find_answers` reads them."""
    rows = [
        (
            SEGMENTS.index(f.segment), *generic_limb_point(f.u, f.theta), f.radius, f.threshold, f.saturation,
            _MEASURES.index(f.measure),
        )
        for f in fields
    ]  # fmt: skip
    return read_only(np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(-1, 8).T))


@inlined
def _felt(fields: Array, closest: int, numbers: Array, c: int, places: Array, begin: int, end: int) -> float:
    """The force [N] of a contact that a field compares, see `tci.skin.contacts.weighted_force`."""
    if fields[_MEASURE, closest] == 1.0:
        return numbers[c, FORCE]
    if fields[_MEASURE, closest] == 2.0:
        return numbers[c, PEAK]
    total, weights = 0.0, 0.0
    reach, u, y, z = 2.0 * fields[_RADIUS, closest], numbers[c, U], numbers[c, Y], numbers[c, Z]
    for k in range(begin, end):
        dx, dy, dz = places[1, k] - u, places[2, k] - y, places[3, k] - z
        weight = reach - np.sqrt(dx * dx + dy * dy + dz * dz)
        if weight > 0.0:
            total += weight * places[0, k]
            weights += weight
    return total / weights if weights > 0.0 else 0.0


@inlined
def _squares(fields: Array, segment: float, u: float, y: float, z: float, squares: Array) -> None:
    """Squared distance from each field that a contact lies in, infinite from others; several at once."""
    places, xs, ys, zs, radii = fields[_SEGMENT], fields[_X], fields[_Y], fields[_Z], fields[_RADIUS]
    for i in range(len(squares)):
        dx, dy, dz = xs[i] - u, ys[i] - y, zs[i] - z
        square = dx * dx + dy * dy + dz * dz
        inside = (square < radii[i] * radii[i]) & (places[i] == segment)
        squares[i] = square if inside else np.inf


@compiled(
    void(
        reads(2), boolean, reads(1, int64), views(1, int64), views(1, int64), reads(2), reads(2), writes(1),
        writes(1, int64), writes(1),
    ),
)  # fmt: skip
def find_answers(
    fields: Array,
    cosine: bool,
    segments: NDArray[np.int64],
    patch: NDArray[np.int64],
    bounds: NDArray[np.int64],
    numbers: Array,
    places: Array,
    squares: Array,
    nearest: NDArray[np.int64],
    gains: Array,
) -> None:
    """Of each contact of a table the `nearest` (c,) of the `fields` (8, m) that it lies in, -1 for none, and
    the `gains` (c,) phi(F) psi(d).

    All about them is as in `ContactTable`; `squares` (m,) is room to work in.
    """
    for c in range(len(numbers)):
        _squares(fields, np.float64(segments[patch[c]]), numbers[c, U], numbers[c, Y], numbers[c, Z], squares)
        closest, least = -1, np.inf
        for i in range(len(squares)):
            if squares[i] < least:
                closest, least = i, squares[i]
        nearest[c], gains[c] = closest, 0.0
        if closest >= 0:
            radius, apart = fields[_RADIUS, closest], np.sqrt(least)
            felt = _felt(fields, closest, numbers, c, places, bounds[c], bounds[c + 1])
            gain = _phi(felt, fields[_THRESHOLD, closest], fields[_SATURATION, closest])
            gains[c] = gain * (_psi_cosine(apart, radius) if cosine else _psi(apart, radius))
