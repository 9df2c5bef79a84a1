"""Regions: named groups of taxels with statistics, as in Skinware (Youssefi et al. 2015)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import TciError
from tci.messages import JointReading, SkinState
from tci.messages.frames import Array, read_only
from tci.robot.limb import generic_limb_distance
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """A group of taxels on one or several patches."""

    name: str
    taxels: Mapping[str, NDArray[np.intp]]
    """Indices (k,) of the region's taxels on each patch, by the patch's name."""


@dataclass(frozen=True, slots=True)
class RegionState:
    """Statistics of a region in one state of the skin."""

    force: float
    """Sum of the forces [N] on the region's taxels."""
    peak_pressure: float
    """Largest pressure [Pa] on a taxel of the region."""
    mean_pressure: float
    """Mean pressure [Pa] over the active taxels. 0 if no taxel is active."""
    area: float
    """Total area [m2] of active taxels."""
    active: int
    """Number of active taxels."""
    coverage: float
    """Fraction (0..1) of the region's taxels that are in use: not masked, and on a patch that has sent a
    frame."""


def region(skin: Skin, name: str, taxels: Mapping[str, ArrayLike]) -> Region:
    """Returns a region made of `taxels`, given as indices on each patch.

    Raises TciError if the region is empty, or if an index is out of range or occurs twice. Raises
    UnknownNameError for an unknown patch.
    """
    found = {}
    for patch, indices in taxels.items():
        skin.robot.patch(patch)
        count = len(skin.surfaces[patch].positions)
        own = np.atleast_1d(np.asarray(indices))
        whole = own.dtype.kind in "iu" and own.ndim == 1
        if not whole or np.any((own < 0) | (own >= count)) or len(np.unique(own)) < len(own):
            raise TciError(
                f"region {name!r}: taxels of {patch}; valid: each of 0 to {count - 1} at most once"
            )
        if len(own):
            found[patch] = read_only(own, np.intp)
    if not found:
        raise TciError(f"region {name!r} has no taxels; valid: at least one")
    return Region(name, found)


def patch_region(skin: Skin, patch: str) -> Region:
    """Returns a region with all taxels of a patch.

    The region's name is the patch's name. Raises UnknownNameError for an unknown patch.
    """
    skin.robot.patch(patch)
    return region(skin, patch, {patch: np.arange(len(skin.surfaces[patch].positions))})


def limb_region(
    skin: Skin, name: str, part: str, segment: str, *, u: float, theta: float, radius: float,
    joints: JointReading,
) -> Region:  # fmt: skip
    """Returns the taxels within `radius` [limb lengths] of a place (u, theta [rad]) on the generic limb.

    The region has the shape of a receptive field. The taxels of the region are computed for the posture
    `joints`. The region keeps these taxels when a rotation about the limb's axis later turns the skin. Raises
    TciError if no taxel is within the radius.
    """
    near = {}
    for patch in skin.robot.patches:
        if (patch.part, patch.segment) == (part, segment) and skin.robot.limb_segment(patch):
            own_u, own_theta, _ = skin.limb(patch.name, joints)
            near[patch.name] = np.flatnonzero(generic_limb_distance(own_u, own_theta, u, theta) < radius)
    return region(skin, name, near)


def region_state(skin: Skin, what: Region, state: SkinState) -> RegionState:
    """Returns the statistics of a region in a state of the skin."""
    force = peak = total = area = 0.0
    active = used = count = 0
    places = {patch.name: p for p, patch in enumerate(skin.robot.patches)}
    for patch, taxels in what.taxels.items():
        count += len(taxels)
        p, areas = places[patch], skin.surfaces[patch].areas[taxels]
        if np.isnan(state.stamp[p]):
            continue
        pressure: Array = state.on(p)[taxels]
        pressed = pressure > 0.0
        masked = None if state.masked is None else state.masked[state.taxels[p] + taxels]
        used += len(taxels) if masked is None else int(np.count_nonzero(~masked))
        force += float((pressure * areas).sum())
        peak = max(peak, float(pressure.max()))
        total += float(pressure[pressed].sum())
        active += int(np.count_nonzero(pressed))
        area += float(areas[pressed].sum())
    return RegionState(force, peak, total / active if active else 0.0, area, active, used / count)
