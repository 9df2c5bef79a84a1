"""The force-distance model (eqs 5-7) for one contact and all fields, compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import boolean, float64, int64, void
from numpy.typing import NDArray

from tci.capabilities import discounts
from tci.capabilities.fields import ReceptiveField
from tci.frames import Array, read_only
from tci.interface.generic_limb import generic_limb_point
from tci.interface.kernels.arrays import reads, returns, views, writes
from tci.interface.kernels.compiled import compiled, inlined
from tci.interface.kernels.contacts import FORCE, PEAK, THETA, U
from tci.interface.kernels.weighted_force import limb_point, mean_force
from tci.model.generic_arm import SEGMENTS

_SEGMENT, _X, _Y, _Z, _RADIUS, _THRESHOLD, _SATURATION, _MEASURE = range(8)
_MEASURES = ("weighted", "sum", "peak")
PLACE = {segment: place for place, segment in enumerate(SEGMENTS)}
"""Number of a segment in the table of fields."""

_phi, _psi, _psi_cosine = [inlined(f) for f in (discounts.phi, discounts.psi, discounts.psi_cosine)]


def field_table(fields: Sequence[ReceptiveField]) -> Array:
    """The fields in numbers (m, 8), as `find_answer` reads them."""
    rows = [
        (
            PLACE[f.segment], *generic_limb_point(f.u, f.theta), f.radius, f.threshold, f.saturation,
            _MEASURES.index(f.measure),
        )
        for f in fields
    ]  # fmt: skip
    return read_only(np.array(rows, dtype=np.float64).reshape(-1, 8))


@compiled(
    returns(int64, float64)(
        reads(2), boolean, int64, float64, float64, float64, float64, views(1), views(1), views(1)
    ),
    calls=(discounts,),
)  # fmt: skip
def find_answer(
    fields: Array,
    cosine: bool,
    segment: int,
    u: float,
    theta: float,
    force: float,
    peak: float,
    taxel_u: Array,
    taxel_theta: Array,
    taxel_forces: Array,
) -> tuple[int, float]:
    """The closest of the `fields` (m, 8) that a contact lies in, -1 for none, and phi(F) psi(d).

    The contact is at `u`, `theta` [rad] of a `segment`; its forces [N] and taxels (k,) are as in `Contact`.
    """
    closest, least = -1, np.inf
    y, z = limb_point(theta)
    for i in range(len(fields)):
        if int(fields[i, _SEGMENT]) == segment:
            dx, dy, dz = fields[i, _X] - u, fields[i, _Y] - y, fields[i, _Z] - z
            apart = np.sqrt(dx * dx + dy * dy + dz * dz)
            if apart < fields[i, _RADIUS] and apart < least:
                closest, least = i, apart
    if closest < 0:
        return -1, 0.0
    radius = fields[closest, _RADIUS]
    felt = force
    if fields[closest, _MEASURE] == 0.0:
        felt = mean_force(u, theta, taxel_u, taxel_theta, taxel_forces, radius)
    elif fields[closest, _MEASURE] == 2.0:
        felt = peak
    gain = _phi(felt, fields[closest, _THRESHOLD], fields[closest, _SATURATION])
    gain *= _psi_cosine(least, radius) if cosine else _psi(least, radius)
    return closest, gain


@compiled(
    void(
        reads(2), boolean, reads(1, int64), views(1, int64), views(1, int64), reads(2), reads(2),
        writes(1, int64), writes(1),
    ),
    calls=(discounts,),
)  # fmt: skip
def find_answers(
    fields: Array,
    cosine: bool,
    segments: NDArray[np.int64],
    patch: NDArray[np.int64],
    bounds: NDArray[np.int64],
    numbers: Array,
    places: Array,
    closest: NDArray[np.int64],
    gains: Array,
) -> None:
    """`find_answer` for each contact of a table, with the `segments` (p,) of its patches."""
    for c in range(len(numbers)):
        begin, end = bounds[c], bounds[c + 1]
        closest[c], gains[c] = find_answer(
            fields, cosine, segments[patch[c]], numbers[c, U], numbers[c, THETA], numbers[c, FORCE],
            numbers[c, PEAK], places[1, begin:end], places[2, begin:end], places[0, begin:end],
        )  # fmt: skip
