"""Arms of straight segments, to check base motions without a model of the robot.

The shoulder of an ideal arm is at the mount's origin. Segment lengths, elbow offset and limits are those of
the robot. Its skin is fixed to the segments as the robot's skin is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.capabilities.fields import ReceptiveField
from tci.messages.frames import Array, read_only
from tci.robot.generic_arm import (
    Side,
    limb_direction,
    segment_rotation,
    side_sign,
)

COMMON_RANGE = read_only(np.deg2rad([[-10, 95.5], [0, 76], [-29.5, 65], [15, 88.5], [-60, 60]]))
"""Range (5, 2) [rad] of the generic angles that both robots reach."""
INITIAL = read_only(np.deg2rad([25.0, 25.0, 0.0, 60.0, 0.0]))
"""Initial generic posture (5,) [rad] of both robots."""
SKIN_RADIUS = 0.04
"""Radius [m] of the skin around a segment's axis, on both robots."""


@dataclass(frozen=True)
class IdealArm:
    """Model of one arm in its mount frame."""

    upper_arm: float
    """Length of the upper arm [m]."""
    forearm: float
    """Distance [m] from the elbow to the hand, where the coordinate u is 1."""
    elbow_lateral: float
    """Lateral offset [m] of elbow and forearm. Internal rotation does not turn this offset."""
    elbow_anterior: float
    """Forward offset [m] of the elbow's axis. At zero flexion forearm and upper arm are in line."""
    skin_turns: bool
    """True if the skin turns with the segment's axial rotation."""
    lower: tuple[float, ...]
    """Smallest generic angles (5,) [deg]."""
    upper: tuple[float, ...]
    """Largest generic angles (5,) [deg]."""

    def clip(self, posture: Array) -> Array:
        """Returns the nearest posture (5,) [rad] within the limits."""
        return np.clip(posture, np.deg2rad(self.lower), np.deg2rad(self.upper))

    def point(self, segment: str, posture: Array, side: Side, p_S: Array, *, axial: bool) -> Array:
        """Returns the point (3,) [m] in the mount frame of `p_S` (3,) [m] in the segment's frame S."""
        placed = segment_rotation(segment, posture, side, axial=axial) @ p_S
        if segment == "forearm":
            sideways = np.array([0.0, side_sign(side) * self.elbow_lateral, -self.upper_arm])
            forward = np.array([self.elbow_anterior, 0.0, 0.0])
            placed += segment_rotation("upper_arm", posture, side) @ sideways
            placed += segment_rotation("upper_arm", posture, side, axial=True) @ forward
            placed -= segment_rotation("forearm", posture, side) @ forward
        return placed

    def hand(self, posture: Array, side: Side) -> Array:
        """Returns the position (3,) [m] of the forearm's distal end in the mount frame."""
        return self.point("forearm", posture, side, np.array([0.0, 0.0, -self.forearm]), axial=False)

    def withdrawal(self, field: ReceptiveField, posture: Array, target: Array, side: Side) -> float:
        """Returns the displacement [m] of the skin at the field's centre, along its inward normal, when the
        arm moves to `target`."""
        length = self.forearm if field.segment == "forearm" else self.upper_arm
        outward_S = limb_direction(field.theta, side)
        p_S = np.array([0.0, 0.0, -field.u * length]) + SKIN_RADIUS * outward_S
        R_MS = segment_rotation(field.segment, posture, side)
        if self.skin_turns:
            own_S = segment_rotation(field.segment, posture, side, axial=True).T @ R_MS @ p_S
        else:
            own_S = p_S
        before = self.point(field.segment, posture, side, p_S, axial=False)
        after = self.point(field.segment, target, side, own_S, axial=self.skin_turns)
        return float((before - after) @ R_MS @ outward_S)


NAO = IdealArm(
    upper_arm=0.105,
    forearm=0.1137,
    elbow_lateral=0.015,
    elbow_anterior=0.0,
    skin_turns=False,
    lower=(-29.5, -18.0, -29.5, 2.0, -104.5),
    upper=(209.5, 76.0, 209.5, 88.5, 104.5),
)
ICUB = IdealArm(
    upper_arm=0.15228,
    forearm=0.1373,
    elbow_lateral=0.0,
    elbow_anterior=0.015,
    skin_turns=True,
    lower=(-10.0, 0.0, -52.0, 15.0, -60.0),
    upper=(95.5, 160.8, 65.0, 106.0, 60.0),
)
