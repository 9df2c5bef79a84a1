"""Contacts: taxels that are pressed together, with their centre of pressure on the skin (eq. 7).

Clusters come first: taken over the whole skin, the mean of eq. 7 would put two touches of a limb
onto the bare skin between them, or inside the limb.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError, UnknownNameError
from tci.frames import Array
from tci.interface.kernels.contacts import F_T, NUMBERS, P_L, VECTORS, cluster
from tci.interface.kernels.flat import adjacency
from tci.interface.kernels.flat_skin import FlatSkin
from tci.interface.kernels.weighted_force import mean_force
from tci.interface.kernels.whole import cluster_all, describe_all
from tci.interface.skin.contact_table import ContactTable
from tci.interface.skin.felt import FeltPatches
from tci.interface.skin.lone import LoneSettings
from tci.interface.skin.skin import Skin
from tci.interface.skin.tracking import Tracker
from tci.messages import Contact, SkinState

_NOWHERE = np.zeros((4, 4))
Measure = Literal["weighted", "sum", "peak"]
"""One force for a contact: F-bar of eq. 7, the force of all its taxels, or that of the strongest."""


@dataclass(frozen=True, slots=True)
class ContactSettings:
    """What counts as a touch."""

    touch: float = 0.1
    """A contact has at least one taxel that feels this much [N]. Ours: 4 of an iCub's 240 counts."""
    floor: float = 0.01
    """It grows over neighbours that feel this much [N], so that the weak edge of a touch is not lost.
    Ours: below one of an iCub's counts; a sensor that flickers at rest needs more."""
    lone: LoneSettings | None = field(default_factory=LoneSettings)
    """When a taxel that is pressed all alone is a touch; None: always."""

    def __post_init__(self) -> None:
        if not 0.0 < self.floor <= self.touch < np.inf:
            values = f"floor={self.floor}, touch={self.touch}"
            raise TciError(f"contact settings {values}; valid: 0 < floor <= touch, both finite")


def find_contacts(
    skin: Skin,
    state: SkinState,
    posture: Mapping[str, Array],
    *,
    settings: ContactSettings = ContactSettings(),
    tracker: Tracker | None = None,
) -> Sequence[Contact]:
    """All contacts of the skin, patch by patch in the robot's order, the strongest first.

    `posture` holds the generic angles (n,) [rad] of each part that carries skin. A `tracker` gives contacts
    the identity that they had in the frame before; without one all are new, and no lone taxel waits. Raises
    UnknownNameError when the posture lacks a part that is touched.
    """
    flat = skin.flat_skin()
    known = state.patches.felt if isinstance(state.patches, FeltPatches) else state.patches
    felt = [known.get(site.patch) for site in flat.sites]
    if not flat.sites:
        return ()
    force, active, actives = skin.force_now(flat, state)
    # NaN is neither above nor below anything, so it never seeds a contact and never joins one.
    count, taxels, lone = cluster_all(
        force,
        settings.floor,
        settings.touch,
        active,
        actives,
        flat.graph,
        flat.begins,
        flat.work,
        flat.counts,
    )
    stamps = [np.nan if one is None else one.stamp for one in felt] if count else []
    waits, tracker = tracker is not None, tracker or Tracker()
    if lone and settings.lone is not None:
        count, taxels = tracker.lone.leave_out(
            flat,
            force,
            *skin.noticed(flat),
            stamps,
            lone,
            waits,
            floor=settings.floor,
            settings=settings.lone,
        )
    else:
        tracker.lone.nobody_waits()
    if not count:
        tracker.lone.remember()
        return ()
    touched = flat.counts.nonzero()[0].tolist()
    for p in touched:
        if flat.sites[p].part not in posture:
            raise UnknownNameError("generic part in this posture", flat.sites[p].part, posture)
    numbers, vectors = np.empty((count, NUMBERS)), np.empty((count, VECTORS, 3))
    indices, places = np.empty(taxels, np.intp), np.empty((4, taxels))
    rows = np.empty((3, count + 1), np.int64)
    describe_all(
        force, flat.work, flat.begins, flat.counts, flat.taxels, flat.faces, flat.box, flat.cells,
        flat.limb, _poses(flat, state), _postures(flat, posture), flat.on, numbers, vectors, indices, places,
        rows,
    )  # fmt: skip
    for p in touched:
        if (one := felt[p]) is not None and one.vector is not None:
            _turn(p, one.vector, flat, state, rows, vectors, indices)
    sequences = [-1 if one is None else one.sequence for one in felt]
    tracker.lone.remember(rows[0], rows[1, :-1], indices)
    told = tracker.follow(rows[1, :-1], vectors[:, P_L], np.array(stamps))
    return ContactTable(
        flat.sites, flat.segments, stamps, sequences, rows, numbers, vectors, indices, places, told
    )


def find_clusters(
    forces: Array, neighbours: NDArray[np.intp], settings: ContactSettings
) -> list[NDArray[np.intp]]:
    """Taxels (k,) of every contact: single-link clusters over the surface's `neighbours` (pairs, 2).

    `forces` (taxels,) [N]. A cluster holds taxels above the floor, at least one of them above the
    touch threshold.
    """
    work = np.zeros(4 * forces.size + 1, np.int32)
    count = cluster(forces, settings.floor, settings.touch, adjacency(forces.size, neighbours), work)
    bounds = work[forces.size : forces.size + count + 1]
    return [work[begin:end].astype(np.intp) for begin, end in pairwise(bounds)]


def centre_of_pressure(positions: Array, forces: Array) -> Array:
    """P-bar (3,) [m] of eq. 7: mean of `positions` (k, 3) [m] weighted by `forces` (k,) [N].

    On a curved limb it lies below the skin; an even grip all around puts it on the axis.
    """
    centre: Array = forces @ positions / forces.sum()
    return centre


def weighted_force(contact: Contact, radius: float, *, measure: Measure = "weighted") -> float:
    """F-bar [N] of eq. 7: mean taxel force, weighted by 2 r minus the distance of P_t and P.

    `radius` r [limb lengths] is that of the receptive field. Weights below zero, which eq. 7 gives to
    taxels farther than 2 r from the centre, are left out; without any weight the result is 0. The
    weighted mean falls when weak taxels join a strong one; `measure` "sum" and "peak" do not.
    Raises UnknownNameError for another measure.
    """
    if measure == "sum":
        return contact.force
    if measure == "peak":
        return contact.peak_force
    if measure != "weighted":
        raise UnknownNameError("force measure", measure, ("weighted", "sum", "peak"))
    force: float = mean_force(
        contact.u, contact.theta, contact.taxel_u, contact.taxel_theta, contact.taxel_forces, radius
    )
    return force


def _poses(flat: FlatSkin, state: SkinState) -> Array:
    """`T_TL` (l, 4, 4) of the skin's links."""
    return np.array([state.link_poses.get(link, _NOWHERE) for link in flat.links])


def _postures(flat: FlatSkin, posture: Mapping[str, Array]) -> Array:
    """Generic angles (l, 4) [rad] of the limbs, as `limb_pose` needs them."""
    result = np.zeros((max(len(flat.parts), 1), 4))
    for row, part in enumerate(flat.parts):
        if part in posture:
            result[row] = posture[part][:4]
    return result


def _turn(
    p: int,
    vector: Array,
    flat: FlatSkin,
    state: SkinState,
    rows: NDArray[np.int64],
    vectors: Array,
    indices: NDArray[np.intp],
) -> None:
    """Write the force of the contacts of a patch whose taxels feel its `vector` (n, 3) [N]."""
    R_TL = state.link_poses[flat.patch_links[p]][:3, :3]
    for row in np.flatnonzero(rows[1, :-1] == p).tolist():
        own = indices[rows[0, row] : rows[0, row + 1]]
        vectors[row, F_T] = R_TL @ vector[own].sum(axis=0)
