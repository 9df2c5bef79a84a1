"""Contacts: taxels that are pressed together, with their centre of pressure on the skin (eq. 7).

Clusters come first: taken over the whole skin, the mean of eq. 7 would put two touches of a limb
onto the bare skin between them, or inside the limb.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError, UnknownNameError
from tci.frames import Array, read_only
from tci.interface.kernels.contacts import NUMBERS, P_L, VECTORS, cluster, describe
from tci.interface.kernels.flat import adjacency
from tci.interface.kernels.weighted_force import mean_force
from tci.interface.skin import Skin
from tci.interface.tracking import Tracker
from tci.messages import Contact, PatchState, SkinState
from tci.model.description import Patch

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
) -> tuple[Contact, ...]:
    """All contacts of the skin, patch by patch in the robot's order, the strongest first.

    `posture` holds the generic angles (n,) [rad] of each part that carries skin. A `tracker` gives contacts
    the identity that they had in the frame before; without one all are new. Raises UnknownNameError when
    the posture lacks a part that is touched.
    """
    tracker = tracker or Tracker()
    contacts: list[Contact] = []
    for patch in skin.robot.patches:
        felt = state.patches.get(patch.name)
        if felt is None:
            continue
        flat = skin.flat(patch.name)
        # NaN is neither above nor below anything, so it never seeds a contact and never joins one.
        count = cluster(felt.force, settings.floor, settings.touch, flat.graph, flat.work)
        if count:
            if patch.part not in posture:
                raise UnknownNameError("generic part in this posture", patch.part, posture)
            contacts += _contacts(count, skin, patch, felt, state, posture[patch.part], tracker)
    return tuple(contacts)


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


def _contacts(
    count: int,
    skin: Skin,
    patch: Patch,
    felt: PatchState,
    state: SkinState,
    posture: Array,
    tracker: Tracker,
) -> list[Contact]:
    """The contacts of one patch that `cluster` found, the strongest first."""
    flat = skin.flat(patch.name)
    size = len(felt.force)
    bounds = flat.work[size : size + count + 1].tolist()
    numbers, vectors = np.empty((count, NUMBERS)), np.empty((count, VECTORS, 3))
    indices, places = np.empty(bounds[-1], np.intp), np.empty((3, bounds[-1]))
    describe(
        felt.force, flat.work, flat.taxels, flat.faces, flat.box, flat.cells,
        state.link_poses[patch.link], state.link_poses[flat.link], flat.limb, posture,
        numbers, vectors, indices, places,
    )  # fmt: skip
    for array in (vectors, indices, places):
        array.setflags(write=False)
    forces, taxel_u, taxel_theta = places
    identities = tracker.follow(patch.name, vectors[:, P_L], felt.stamp)
    found = []
    for index, (force, peak, area, u, theta) in enumerate(numbers.tolist()):
        own = slice(bounds[index], bounds[index + 1])
        identity, began, moved = identities[index]
        centre_L, n_L, p_T, n_T, f_T = vectors[index]
        if felt.vector is not None:
            f_T = read_only(state.link_poses[patch.link][:3, :3] @ felt.vector[indices[own]].sum(axis=0))
        found.append(
            Contact(
                patch=patch.name,
                part=patch.part,
                segment=patch.segment,
                stamp=felt.stamp,
                sequence=felt.sequence,
                taxels=indices[own],
                taxel_forces=forces[own],
                force=force,
                peak_force=peak,
                area=area,
                p_L=centre_L,
                n_L=n_L,
                p_T=p_T,
                n_T=n_T,
                f_T=f_T,
                u=u,
                theta=theta,
                taxel_u=taxel_u[own],
                taxel_theta=taxel_theta[own],
                identity=identity,
                began=began,
                moved=moved,
            )
        )
    found.sort(key=lambda contact: (-contact.force, contact.u, contact.theta))
    return found
