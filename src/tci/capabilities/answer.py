"""The force-distance model (eqs 5-7) for one contact and all fields, compiled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import boolean, float64, int64, njit

from tci.capabilities import discounts
from tci.capabilities.fields import ReceptiveField
from tci.frames import Array, read_only
from tci.interface.kernels.arrays import reads, returns, views
from tci.interface.kernels.weighted_force import limb_distance, mean_force
from tci.model.generic_arm import SEGMENTS

_SEGMENT, _U, _THETA, _RADIUS, _THRESHOLD, _SATURATION, _MEASURE = range(7)
_MEASURES = ("weighted", "sum", "peak")
PLACE = {segment: place for place, segment in enumerate(SEGMENTS)}
"""Number of a segment in the table of fields."""

_phi = njit(cache=True, error_model="numpy")(discounts.phi)
_psi = njit(cache=True, error_model="numpy")(discounts.psi)
_psi_cosine = njit(cache=True, error_model="numpy")(discounts.psi_cosine)


def field_table(fields: Sequence[ReceptiveField]) -> Array:
    """The fields in numbers (m, 7), as `find_answer` reads them."""
    rows = [
        (PLACE[f.segment], f.u, f.theta, f.radius, f.threshold, f.saturation, _MEASURES.index(f.measure))
        for f in fields
    ]
    return read_only(np.array(rows, dtype=np.float64).reshape(-1, 7))


@njit(  # type: ignore[untyped-decorator]
    returns(int64, float64)(
        reads(2), boolean, int64, float64, float64, float64, float64, views(1), views(1), views(1)
    ),
    cache=True,
    error_model="numpy",
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
    """The closest of the `fields` (m, 7) that a contact lies in, -1 for none, and phi(F) psi(d).

    The contact is at `u`, `theta` [rad] of a `segment`; its forces [N] and taxels (k,) are as in `Contact`.
    """
    closest, least = -1, np.inf
    for i in range(len(fields)):
        if int(fields[i, _SEGMENT]) == segment:
            apart = limb_distance(u, theta, fields[i, _U], fields[i, _THETA])
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
