"""How much of a place on the generic limb its skin still feels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.messages import Covered, JointReading
from tci.robot.limb import generic_limb_distance
from tci.skin.felt import FeltPatches
from tci.skin.skin import Skin

TURNED = np.deg2rad(1.0)
"""Angle [rad] by which a joint must have moved for the places of taxels to be worked out anew. Ours."""


class Coverage:
    """Knows which taxels are masked, and where they are. It works only where any is."""

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._masks: tuple[NDArray[np.bool_], ...] = ()
        self._patches = 0
        self._covered: Covered | None = None
        self._blind: set[tuple[str, str]] = set()
        self._position: Array | None = None

    def step(self, joints: JointReading) -> Covered | None:
        """What tells the coverage of any place in the skin's latest state, with the joints where they are;
        None while all taxels are used. Joints that are not finite leave it as it was."""
        felt = self._skin.felt
        if felt.masks is not self._masks or len(felt) != self._patches:
            self._masks, self._patches = felt.masks, len(felt)
            self._blind, self._position = self._masked(), None
        if not self._blind:
            self._covered = None
        elif self._has_moved(joints.position):
            self._covered, self._position = self._places(felt, joints), joints.position
        return self._covered

    def _has_moved(self, position: Array) -> bool:
        if not np.isfinite(position).all():
            return False
        return self._position is None or bool(np.abs(position - self._position).max(initial=0.0) > TURNED)

    def _masked(self) -> set[tuple[str, str]]:
        """Parts and segments on whose skin any taxel is masked."""
        patches = zip(self._skin.robot.patches, self._masks, strict=True)
        return {(patch.part, patch.segment) for patch, mask in patches if mask.any()}

    def _places(self, felt: FeltPatches, joints: JointReading) -> Covered:
        places: dict[tuple[str, str], list[tuple[Array, Array, NDArray[np.bool_]]]] = {}
        for name, patch in felt.items():
            words = self._skin.robot.patch(name)
            here = words.part, words.segment
            if here not in self._blind or self._skin.robot.limb_segment(words) is None:
                continue
            u, theta, _ = self._skin.limb(name, joints)
            masked = np.zeros(len(u), dtype=bool) if patch.masked is None else patch.masked
            places.setdefault(here, []).append((u, theta, masked))

        def covered(part: str, segment: str, u: float, theta: float, radius: float) -> float:
            masked = [
                mask[generic_limb_distance(taxel_u, taxel_theta, u, theta) < radius]
                for taxel_u, taxel_theta, mask in places.get((part, segment), ())
            ]
            here = np.concatenate(masked) if masked else np.zeros(0, dtype=bool)
            return 1.0 - float(here.mean()) if here.size else 1.0

        return covered
