"""Contacts: taxels that are pressed together, with their centre of pressure on the skin (eq. 7).

Clusters come first: taken over the whole skin, the mean of eq. 7 would put two touches of a limb
onto the bare skin between them, or inside the limb.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError, UnknownNameError
from tci.frames import Array, apply, invert, read_only
from tci.interface.generic_limb import generic_limb_distance
from tci.interface.skin import Skin, segment_pose
from tci.messages import Contact, PatchState, SkinState
from tci.model.description import Patch
from tci.model.generic_arm import limb_coordinates
from tci.model.surfaces import Surface

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
) -> tuple[Contact, ...]:
    """All contacts of the skin, patch by patch in the robot's order, the strongest first.

    `posture` holds the generic angles (n,) [rad] of each part that carries skin. Raises
    UnknownNameError when it lacks one that is touched.
    """
    contacts: list[Contact] = []
    for patch in skin.robot.patches:
        felt = state.patches.get(patch.name)
        # NaN is neither above nor below anything, so it never seeds a contact and never joins one.
        if felt is None or not (felt.force >= settings.touch).any():
            continue
        if patch.part not in posture:
            raise UnknownNameError("generic part in this posture", patch.part, posture)
        clusters = find_clusters(felt.force, skin.surfaces[patch.name].neighbours, settings)
        T_TL, T_SL = _poses(skin, patch, state, posture[patch.part])
        found = [_contact(skin, patch, felt, taxels, T_TL, T_SL) for taxels in clusters]
        contacts += sorted(found, key=lambda contact: (-contact.force, contact.u, contact.theta))
    return tuple(contacts)


def find_clusters(
    forces: Array, neighbours: NDArray[np.intp], settings: ContactSettings
) -> list[NDArray[np.intp]]:
    """Taxels (k,) of every contact: single-link clusters over the surface's `neighbours` (pairs, 2).

    `forces` (taxels,) [N]. A cluster holds taxels above the floor, at least one of them above the
    touch threshold.
    """
    active = forces >= settings.floor
    pairs = neighbours[active[neighbours[:, 0]] & active[neighbours[:, 1]]]
    labels = connected(forces.size, pairs)
    seeds = np.unique(labels[forces >= settings.touch])
    return [np.flatnonzero(active & (labels == seed)) for seed in seeds]


def connected(count: int, pairs: NDArray[np.intp]) -> NDArray[np.intp]:
    """Label (count,) of each node: the smallest node that `pairs` (m, 2) connect it with.

    Hooks each node to the smallest label at its pairs, then shortens the chains, until nothing
    changes (Shiloach and Vishkin 1982); a Python loop over pairs, or a sparse matrix, is slower.
    """
    labels = np.arange(count)
    one, other = pairs[:, 0], pairs[:, 1]
    while True:
        lower = np.minimum(labels[one], labels[other])
        hooked = labels.copy()
        np.minimum.at(hooked, one, lower)
        np.minimum.at(hooked, other, lower)
        hooked = hooked[hooked]
        if np.array_equal(hooked, labels):
            return labels
        labels = hooked


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
    distances = generic_limb_distance(contact.taxel_u, contact.taxel_theta, contact.u, contact.theta)
    weights = np.maximum(2.0 * radius - distances, 0.0)
    total = weights.sum()
    return float(weights @ contact.taxel_forces / total) if total > 0.0 else 0.0


def _poses(skin: Skin, patch: Patch, state: SkinState, posture: Array) -> tuple[Array, Array]:
    """`T_TL` and `T_SL` (4, 4) of the patch's link L, seen from the torso and from its segment S."""
    part = skin.robot.part(patch.part)
    segment = part.segment(patch.segment)
    T_TL = state.link_poses[patch.link]
    return T_TL, invert(segment_pose(part, segment, state.link_poses[segment.link], posture)) @ T_TL


def _contact(
    skin: Skin, patch: Patch, felt: PatchState, taxels: NDArray[np.intp], T_TL: Array, T_SL: Array
) -> Contact:
    surface = skin.surfaces[patch.name]
    part = skin.robot.part(patch.part)
    assert part.side is not None  # Skin refuses patches elsewhere
    positions, forces = surface.positions[taxels], felt.force[taxels]
    p_L, n_L = project(surface, centre_of_pressure(positions, forces))
    n_T = T_TL[:3, :3] @ n_L
    # The centre is the first row, its taxels follow.
    points_S = apply(T_SL, np.concatenate([p_L[None], positions]))
    u, theta = limb_coordinates(points_S, part.segment(patch.segment).length, part.side)
    return Contact(
        patch=patch.name,
        part=patch.part,
        segment=patch.segment,
        stamp=felt.stamp,
        sequence=felt.sequence,
        taxels=read_only(taxels, np.intp),
        taxel_forces=read_only(forces),
        force=float(forces.sum()),
        peak_force=float(forces.max()),
        area=float(surface.areas[taxels].sum()),
        p_L=read_only(p_L),
        n_L=read_only(n_L),
        p_T=read_only(apply(T_TL, p_L)),
        n_T=read_only(n_T),
        f_T=read_only(-forces.sum() * n_T),
        u=float(u[0]),
        theta=float(theta[0]),
        taxel_u=read_only(u[1:]),
        taxel_theta=read_only(theta[1:]),
    )


def project(surface: Surface, point: Array) -> tuple[Array, Array]:
    """Nearest point (3,) [m] of the surface to `point` (3,) [m], and its normal (3,) there.

    The same as `Surface.project`, which goes through all faces. Here a face counts only if each of
    its corners is within an edge of the nearest corner's distance; the nearest face is one of these.
    """
    apart = surface.positions - point
    distances = np.sqrt(np.einsum("ij,ij->i", apart, apart))[surface.faces]
    near = distances.max(axis=1) <= distances.min() + _longest_edge(surface)
    points, normals = replace(surface, faces=surface.faces[near]).project(point[None])
    return points[0], normals[0]


@lru_cache(maxsize=64)
def _longest_edge(surface: Surface) -> float:
    corners = surface.positions[surface.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())
