"""Contacts in plain NumPy. The compiled loops must give equal results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from helpers.felt_skin import FeltSkin, PatchFelt
from tci.messages import JointReading
from tci.messages.frames import apply, invert
from tci.robot.generic_arm import limb_coordinates
from tci.skin.contacts import ContactSettings, centre_of_pressure
from tci.skin.fill_factor import WIDTHS, fill_factors
from tci.skin.formulas import LEAST_FILL, MOST_HIDDEN, NARROW, SEPARATE
from tci.skin.skin import segment_pose
from tci.skin.surfaces import Surface


def connected(count: int, pairs: np.ndarray) -> np.ndarray:
    """Returns the label (count,) of each node: the smallest node that is connected with it by `pairs` (m, 2)
    (Shiloach and Vishkin 1982)."""
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


def project(surface: Surface, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Computes `Surface.project` from the faces that are near the nearest vertex."""
    corners = surface.positions[surface.faces]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    distances = np.linalg.norm(surface.positions - point, axis=1)[surface.faces]
    near = distances.max(axis=1) <= distances.min() + edge
    points, normals = replace(surface, faces=surface.faces[near]).project(point[None])
    return points[0], normals[0]


def contacts(
    skin: FeltSkin,
    felt: Mapping[str, PatchFelt],
    joints: JointReading,
    posture: Mapping[str, np.ndarray],
    settings: ContactSettings,
) -> list[SimpleNamespace]:
    """Returns the contacts in a first state, on patches that belong to limbs."""
    found = []
    poses = skin.kinematics.poses(joints.position, skin.kinematics.links)
    for place, patch in enumerate(skin.robot.patches):
        if patch.name not in felt:
            continue
        one, surface = felt[patch.name], skin.surfaces[patch.name]
        part = skin.robot.part(patch.part)
        segment = part.segment(patch.segment)
        T_TL = poses[patch.link]
        T_TS = segment_pose(part, segment, poses[segment.link], posture[patch.part])
        own = []
        for taxels in clusters(one.force, surface.neighbours, settings):
            positions, forces = surface.positions[taxels], one.force[taxels]
            p_L, n_L = project(surface, centre_of_pressure(positions, forces))
            points_S = apply(invert(T_TS) @ T_TL, np.concatenate([p_L[None], positions]))
            u, theta = limb_coordinates(points_S, segment.length, part.side)
            n_T = T_TL[:3, :3] @ n_L
            strongest = taxels[one.pressure[taxels].argmax()]
            hidden = skin.conditioner.estimates.hidden[skin.layout.taxels[place]][strongest]
            share = 1.0 - min(hidden / one.pressure[strongest], MOST_HIDDEN)
            force = forces.sum() / fill_factor(surface, taxels, forces) / share
            own.append(
                SimpleNamespace(
                    patch=patch.name, part=patch.part, segment=patch.segment, stamp=one.stamp,
                    sequence=one.sequence, taxels=taxels, taxel_forces=forces, force=force,
                    peak=forces.max(), area=surface.areas[taxels].sum(), p_L=p_L, n_L=n_L,
                    p_T=apply(T_TL, p_L), n_T=n_T, f_T=-force * n_T, u=u[0], theta=theta[0],
                    taxel_u=u[1:], taxel_theta=theta[1:],
                )
            )  # fmt: skip
        found += sorted(own, key=lambda contact: (-contact.force, contact.u, contact.theta))
    return found


def fill_factor(surface: Surface, taxels: np.ndarray, forces: np.ndarray) -> float:
    """Returns the fill factor around a touch, averaged over its width."""
    positions = surface.positions[taxels]
    mean = centre_of_pressure(positions, forces)
    spread = forces @ ((positions - mean) ** 2).sum(axis=1) / forces.sum() / 2.0
    pressure = np.zeros(len(surface.areas))
    pressure[taxels] = forces / surface.areas[taxels]
    one, other = np.concatenate([surface.neighbours, surface.neighbours[:, ::-1]]).T
    apart = ((surface.positions[one] - surface.positions[other]) ** 2).sum(axis=1)
    own, beside = (pressure[one] ** 2).sum(), (pressure[one] * pressure[other]).sum()
    if 0.0 < beside < own:
        # of a Gaussian: its autocorrelation at the distance of the neighbours
        place = pressure[one] ** 2 @ apart / own / (4.0 * np.log(own / beside))
        spread = min(spread, SEPARATE * place)
    width = np.sqrt(max(spread, NARROW**2 * surface.areas[taxels].mean()))
    factors = [np.interp(np.log(width), np.log(WIDTHS), row) for row in fill_factors(surface)[taxels]]
    return max(float(forces @ factors / forces.sum()), LEAST_FILL)


class Tracks:
    """Tracking of contacts in plain Python: the closest pairs of a track and a contact are matched first."""

    def __init__(self, reach: float, linger: float) -> None:
        self.reach, self.linger, self.next = reach, linger, 1
        self.known: list[dict[str, Any]] = []

    def follow(self, site: np.ndarray, p_L: np.ndarray, first: np.ndarray, stamps: np.ndarray) -> list[tuple]:
        """Returns identity, onset and displacement of each contact. `first` is the first taxel of each
        contact."""
        self.known = [
            t for t in self.known
            if t["site"] not in site or stamps[t["site"]] - t["seen"] <= self.linger
        ]  # fmt: skip
        pairs = sorted(
            (float(np.linalg.norm(p_L[c] - t["place"])), c, k)
            for c in range(len(site))
            for k, t in enumerate(self.known)
            if t["site"] == site[c]
        )
        own: dict[int, int] = {}
        for far, c, k in pairs:
            if far <= self.reach and c not in own and k not in own.values():
                own[c] = k
        for c in sorted(set(range(len(site))) - own.keys(), key=lambda c: (site[c], first[c])):
            own[c] = len(self.known)
            at = {"site": site[c], "identity": self.next, "onset": stamps[site[c]], "origin": p_L[c].copy()}
            self.known.append(at)
            self.next += 1
        for c, k in own.items():
            self.known[k] |= {"seen": stamps[site[c]], "place": p_L[c].copy()}
        tracks = [self.known[own[c]] for c in range(len(site))]
        return [(t["identity"], t["onset"], float(np.linalg.norm(t["place"] - t["origin"]))) for t in tracks]
