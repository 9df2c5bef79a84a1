"""Fraction of a receptive field's taxels that are trusted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tci.body.landmarks import Landmarks
from tci.frames import Array
from tci.messages import JointReading, Landmark, LimbPlace
from tci.robot.limb import generic_limb_distance
from tci.skin.skin import Skin

Indices = NDArray[np.intp]


class Coverage:
    """Counts the taxels of one robot around places of its skin."""

    def __init__(self, skin: Skin, landmarks: Landmarks) -> None:
        self._skin, self._landmarks = skin, landmarks
        sizes = [len(skin.surfaces[patch.name].positions) for patch in skin.robot.patches]
        begins = np.cumsum([0, *sizes]).tolist()
        self._begins = {patch.name: begin for patch, begin in zip(skin.robot.patches, begins, strict=False)}

    def shares(
        self,
        masked: NDArray[np.bool_],
        joints: JointReading,
        part: str,
        places: Sequence[LimbPlace | Landmark],
        radius: Array,
    ) -> Array:
        """Fraction (m,) of the taxels within `radius` (m,) of each place of a part that are not `masked`
        (n,); 1 where there are none. The joints say where taxels are on a limb."""
        result = np.ones(len(places))
        for m, place in enumerate(places):
            near = (
                self._around_place(part, place, float(radius[m]), joints)
                if isinstance(place, LimbPlace)
                else self._around_landmark(part, place, float(radius[m]))
            )
            if near.size:
                result[m] = 1.0 - masked[near].mean()
        return result

    def _around_place(self, part: str, place: LimbPlace, radius: float, joints: JointReading) -> Indices:
        found = [np.zeros(0, np.intp)]
        for patch in self._skin.robot.patches:
            if (patch.part, patch.segment) != (part, place.segment):
                continue
            if self._skin.robot.limb_segment(patch) is not None:
                u, theta, _ = self._skin.limb(patch.name, joints)
                near = generic_limb_distance(u, theta, place.u, place.theta) < radius
                found.append(self._begins[patch.name] + np.flatnonzero(near))
        return np.concatenate(found)

    def _around_landmark(self, part: str, landmark: Landmark, radius: float) -> Indices:
        found = self._landmarks.around(part, landmark, radius)
        if found is None:
            return np.zeros(0, np.intp)
        taxels: Indices = self._begins[found[0]] + np.flatnonzero(found[1])
        return taxels
