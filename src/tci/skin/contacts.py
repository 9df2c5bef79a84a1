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
from tci.messages import Contact, PatchState, SkinFrame, SkinState
from tci.robot.kernels.weighted_force import mean_force
from tci.robot.kinematics import LinkPoses
from tci.skin.contact_table import ContactTable
from tci.skin.isolated import LoneSettings
from tci.skin.kernels.contacts import F_T, NUMBERS, P_L, VECTORS, cluster
from tci.skin.kernels.flat import Indices, adjacency
from tci.skin.kernels.flat_skin import FlatSkin
from tci.skin.kernels.whole import TAXEL, cluster_all, describe_all
from tci.skin.live_skin import LiveSkin
from tci.skin.tracking import Tracker

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
    skin: LiveSkin,
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
    if not flat.sites or (skin.is_now(flat, state) and skin.felt.untouched):
        if tracker is not None:
            tracker.lone.nobody_waits()
            tracker.lone.remember()
        return ()
    force, active, actives, stamps, frames, states = _felt(skin, flat, state)
    # NaN is neither above nor below anything, so it never seeds a contact and never joins one.
    count, taxels, lone = cluster_all(
        force, settings.floor, settings.touch, active, actives, flat.graph, flat.begins, flat.work,
        flat.counts,
    )  # fmt: skip
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
    angles = _postures(flat, posture)
    numbers, vectors = np.empty((count, NUMBERS)), np.empty((count, VECTORS, 3))
    indices, places = np.empty(taxels, np.intp), np.empty((4, taxels))
    rows = np.empty((3, count + 1), np.int64)
    describe_all(
        force, flat.work, flat.begins, flat.counts, flat.taxels, flat.faces, flat.box, flat.cells,
        flat.limb, _poses(flat, state), angles, flat.on, numbers, vectors, indices, places,
        rows,
    )  # fmt: skip
    if states:
        _turn(states, flat, state, rows, vectors, indices)
    patches = rows[1, :-1]
    tracker.lone.remember(rows[0], patches, indices)
    told = tracker.follow(patches, vectors[:, P_L], stamps)
    return ContactTable(flat.sites, flat.segments, frames, rows, numbers, vectors, indices, places, told)


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


def _felt(
    skin: LiveSkin, flat: FlatSkin, state: SkinState
) -> tuple[
    Array, Indices, NDArray[np.int64], Array, Mapping[str, SkinFrame | PatchState], Mapping[str, PatchState]
]:
    """Force (n,) [N] on the skin's taxels, the active (n,) ones of each patch and how many (p,) they are, see
    `cluster_all`; when each was measured (p,) [s], and in which frame; the states that may have vectors."""
    if skin.is_now(flat, state):
        octets, felt = skin.octets, skin.felt
        return octets.force, octets.active, octets.counts, octets.stamps, felt.frames, felt.others
    flat.force[:] = 0.0
    stamps = np.full(len(flat.sites), np.nan)
    for p, site in enumerate(flat.sites):
        if (one := state.patches.get(site.patch)) is not None:
            flat.force[flat.begins[p, TAXEL] :][: len(one.force)] = one.force
            stamps[p] = one.stamp
    unknown = np.full(len(flat.sites), -1, np.int64)
    return flat.force, flat.work[:0], unknown, stamps, state.patches, state.patches


def _poses(flat: FlatSkin, state: SkinState) -> Array:
    """`T_TL` (l, 4, 4) of the skin's links."""
    poses = state.link_poses
    if isinstance(poses, LinkPoses) and poses.names == flat.links:
        return poses.all
    return np.array([poses.get(link, _NOWHERE) for link in flat.links])


def _postures(flat: FlatSkin, posture: Mapping[str, Array]) -> Array:
    """Generic angles (l, 4) [rad] of the limbs, as `limb_pose` needs them; zeros where they are not known,
    which must be so of no part that is touched."""
    if not posture.keys() >= flat.all_parts:
        for p in flat.counts.nonzero()[0].tolist():
            if flat.sites[p].part not in posture:
                raise UnknownNameError("generic part in this posture", flat.sites[p].part, posture)
    result = np.zeros((max(len(flat.parts), 1), 4))
    for row, part in enumerate(flat.parts):
        if part in posture:
            result[row] = posture[part][:4]
    return result


def _turn(
    states: Mapping[str, PatchState],
    flat: FlatSkin,
    state: SkinState,
    rows: NDArray[np.int64],
    vectors: Array,
    indices: NDArray[np.intp],
) -> None:
    """Write the force of the contacts of patches whose taxels feel a vector (n, 3) [N]."""
    for row, p in enumerate(rows[1, :-1].tolist()):
        one = states.get(flat.sites[p].patch)
        if one is not None and one.vector is not None:
            R_TL = state.link_poses[flat.patch_links[p]][:3, :3]
            own = indices[rows[0, row] : rows[0, row + 1]]
            vectors[row, F_T] = R_TL @ one.vector[own].sum(axis=0)
