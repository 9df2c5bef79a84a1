"""Fraction of a receptive field's taxels that are trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.body.kernels.coverage import PLACE, count_taxels
from tci.body.landmarks import Landmarks
from tci.messages import JointReading, Landmark, LimbPlace
from tci.messages.frames import Array, read_only
from tci.robot.generic_arm import SEGMENTS
from tci.robot.joint_map import joint_map
from tci.robot.kernels.limb import LIMB, limb_record
from tci.robot.limb import generic_limb_point
from tci.skin.skin import Skin

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class _Limb:
    """Taxels on one arm, as arrays for a compiled loop."""

    links: tuple[str, ...]
    on: Indices
    numbers: NDArray[np.void]
    positions: Array
    begins: Indices
    taxels: Indices
    """Index (n,) of each taxel within the whole skin."""


class Coverage:
    """Counts the taxels of one robot around places of its skin."""

    def __init__(self, skin: Skin, landmarks: Landmarks) -> None:
        self._skin, self._landmarks = skin, landmarks
        sizes = [len(skin.surfaces[patch.name].positions) for patch in skin.robot.patches]
        begins = np.cumsum([0, *sizes]).tolist()
        self._begins = {patch.name: begin for patch, begin in zip(skin.robot.patches, begins, strict=False)}
        self._limbs = {part.name: self._limb(part.name) for part in skin.robot.parts}
        self._near: dict[tuple[str, tuple[Landmark, ...], bytes], tuple[Indices, Indices]] = {}

    def shares(
        self,
        masked: NDArray[np.bool_],
        joints: JointReading,
        part: str,
        places: Sequence[LimbPlace | Landmark],
        radius: Array,
    ) -> Array:
        """Returns, for each of m places, the fraction (m,) of the taxels within its `radius` (m,) that are
        trusted. `masked` (n,) is True for the taxels of the whole skin that are not trusted.

        The fraction is 1 for a place without taxels around it. The angles `joints` determine the places of
        taxels on the generic limb.
        """
        counts = np.zeros((2, len(places)))
        limbs = np.array([isinstance(place, LimbPlace) for place in places], np.bool_)
        radius = np.asarray(radius, np.float64)
        if limbs.any():
            own = [place for place in places if isinstance(place, LimbPlace)]
            counts[:, limbs] = self._on_limb(masked, joints, part, own, radius[limbs])
        if not limbs.all():
            marks = tuple(place for place in places if isinstance(place, Landmark))
            counts[:, ~limbs] = self._around(masked, part, marks, radius[~limbs])
        shares: Array = 1.0 - counts[1] / np.maximum(counts[0], 1.0)
        return shares

    def _on_limb(
        self,
        masked: NDArray[np.bool_],
        joints: JointReading,
        part: str,
        places: Sequence[LimbPlace],
        radius: Array,
    ) -> Array:
        """Counts the taxels within `radius` (m,) [limb lengths] of each of m places on a limb. Returns the
        numbers (2, m) of all taxels (row 0) and of masked taxels (row 1)."""
        limb, counts = self._limbs[part], np.zeros((2, len(places)))
        if limb is not None:
            rows = [
                (
                    SEGMENTS.index(place.segment) if place.segment in SEGMENTS else -1,
                    *generic_limb_point(place.u, place.theta),
                    within,
                )
                for place, within in zip(places, radius.tolist(), strict=True)
            ]
            count_taxels(
                self._skin.kinematics.pose_array(joints.position, limb.links), limb.on, limb.numbers,
                joint_map(self._skin.robot, part).to_generic(joints.position), limb.positions, limb.begins,
                masked[limb.taxels], np.array(rows, PLACE), counts,
            )  # fmt: skip
        return counts

    def _around(
        self, masked: NDArray[np.bool_], part: str, landmarks: tuple[Landmark, ...], radius: Array
    ) -> Array:
        """Counts the taxels within `radius` (m,) [m] of each of m landmarks. Returns the numbers (2, m) of
        all taxels (row 0) and of masked taxels (row 1)."""
        key = part, landmarks, radius.tobytes()
        found = self._near.get(key)
        if found is None:
            near = [self._taxels(part, *one) for one in zip(landmarks, radius.tolist(), strict=True)]
            ends = np.cumsum([0, *map(len, near)])
            found = self._near[key] = np.concatenate(near), ends
        taxels, ends = found
        bad = np.concatenate([[0], np.cumsum(masked[taxels])])
        return np.array([np.diff(ends), np.diff(bad[ends])], np.float64)

    def _taxels(self, part: str, landmark: Landmark, radius: float) -> Indices:
        found = self._landmarks.around(part, landmark, radius)
        if found is None:
            return np.zeros(0, np.int64)
        taxels: Indices = self._begins[found[0]] + np.flatnonzero(found[1])
        return taxels

    def _limb(self, name: str) -> _Limb | None:
        robot = self._skin.robot
        part = robot.part(name)
        own = [(p, s) for p in robot.patches if p.part == name and (s := robot.limb_segment(p)) is not None]
        if not own:
            return None
        links = tuple(dict.fromkeys(link for patch, segment in own for link in (patch.link, segment.link)))
        points = [self._skin.surfaces[patch.name].positions for patch, _ in own]
        begins = [self._begins[patch.name] for patch, _ in own]
        taxels = [begin + np.arange(len(one)) for begin, one in zip(begins, points, strict=True)]
        return _Limb(
            links=links,
            on=read_only([(links.index(p.link), links.index(s.link)) for p, s in own], np.int64),
            numbers=read_only([limb_record(part, segment) for _, segment in own], LIMB),
            positions=read_only(np.concatenate(points)),
            begins=read_only(np.cumsum([0, *map(len, points)]), np.int64),
            taxels=read_only(np.concatenate(taxels), np.int64),
        )
