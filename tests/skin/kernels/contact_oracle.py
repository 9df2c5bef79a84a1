"""Contacts in plain NumPy: what the compiled loops must equal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tci.frames import apply, invert
from tci.messages import Contact, SkinState
from tci.robot.generic_arm import limb_coordinates
from tci.skin.contacts import ContactSettings, centre_of_pressure
from tci.skin.kernels.isolated import ONE_SIDED
from tci.skin.live_skin import LiveSkin
from tci.skin.skin import segment_pose
from tci.skin.surfaces import Surface


def connected(count: int, pairs: np.ndarray) -> np.ndarray:
    """Label (count,) of each node: the smallest node that `pairs` (m, 2) connect it with (Shiloach and
    Vishkin 1982)."""
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


def clusters(forces: np.ndarray, neighbours: np.ndarray, settings: ContactSettings) -> list[np.ndarray]:
    active = forces >= settings.floor
    pairs = neighbours[active[neighbours[:, 0]] & active[neighbours[:, 1]]]
    labels = connected(forces.size, pairs)
    seeds = np.unique(labels[forces >= settings.touch])
    return [np.flatnonzero(active & (labels == seed)) for seed in seeds]


def is_touch(skin: LiveSkin, patch: str, forces: np.ndarray, taxel: int, settings: ContactSettings) -> bool:
    """Whether a taxel that is pressed all alone is a touch, in a frame of which nothing came before."""
    lone, surface = settings.lone, skin.surfaces[patch]
    if lone is None:
        return True
    flat = skin.flat_skin()
    own = [site.patch for site in flat.sites].index(patch)
    least = skin.noticed(flat)[0][flat.begins[own, 0] : flat.begins[own + 1, 0]]
    pairs = np.concatenate([surface.neighbours, surface.neighbours[:, ::-1]])
    others = pairs[pairs[:, 0] == taxel, 1]
    ways = surface.positions[others] - surface.positions[taxel]
    apart = np.linalg.norm(ways, axis=1)
    near = (apart > 0.0) & (apart <= lone.reach) & np.isfinite(least[others]) & np.isfinite(forces[others])
    ways = ways[near] - np.outer(ways[near] @ surface.normals[taxel], surface.normals[taxel])
    units = ways / np.maximum(np.linalg.norm(ways, axis=1), 1e-300)[:, None]
    if np.count_nonzero(near) < 2 or np.linalg.norm(units.mean(axis=0)) > ONE_SIDED:
        return True
    area, force = surface.areas[taxel], forces[taxel]
    variance = lone.cover**2 + area / 12.0 + (lone.tip * np.cbrt(force)) ** 2 / 4.0
    pressure = force / area * np.exp(-(apart[near] ** 2) / (2.0 * variance))
    notices = np.maximum(least[others[near]], settings.floor / surface.areas[others[near]])
    return not np.any(pressure >= lone.sure * notices)


def project(surface: Surface, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `Surface.project`, by faces with each corner within an edge of the nearest corner's distance."""
    corners = surface.positions[surface.faces]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    distances = np.linalg.norm(surface.positions - point, axis=1)[surface.faces]
    near = distances.max(axis=1) <= distances.min() + edge
    points, normals = replace(surface, faces=surface.faces[near]).project(point[None])
    return points[0], normals[0]


def contacts(
    skin: LiveSkin, state: SkinState, posture: dict[str, np.ndarray], settings: ContactSettings
) -> list[Contact]:
    found = []
    for patch in skin.robot.patches:
        if patch.name not in state.patches:
            continue
        felt, surface = state.patches[patch.name], skin.surfaces[patch.name]
        part = skin.robot.part(patch.part)
        segment = part.segment(patch.segment)
        T_TL = state.link_poses[patch.link]
        T_TS = segment_pose(part, segment, state.link_poses[segment.link], posture[patch.part])
        own = []
        for taxels in clusters(felt.force, surface.neighbours, settings):
            if len(taxels) == 1 and not is_touch(skin, patch.name, felt.force, taxels[0], settings):
                continue
            positions, forces = surface.positions[taxels], felt.force[taxels]
            p_L, n_L = project(surface, centre_of_pressure(positions, forces))
            points_S = apply(invert(T_TS) @ T_TL, np.concatenate([p_L[None], positions]))
            u, theta = limb_coordinates(points_S, segment.length, part.side)
            n_T = T_TL[:3, :3] @ n_L
            own.append(
                Contact(
                    patch.name, patch.part, patch.segment, felt.stamp, felt.sequence, taxels, forces,
                    forces.sum(), forces.max(), surface.areas[taxels].sum(), p_L, n_L, apply(T_TL, p_L), n_T,
                    -forces.sum() * n_T, u[0], theta[0], u[1:], theta[1:],
                )
            )  # fmt: skip
        found += sorted(own, key=lambda contact: (-contact.force, contact.u, contact.theta))
    return found
