"""The generic arm: five joints to which every humanoid arm is mapped (§3.1).

At generic zero the arm hangs down, the elbow flexes forward and the thumb side faces forward. On both sides,
the positive directions are: shoulder flexion, abduction, internal rotation, elbow flexion and pronation. The
three shoulder angles describe the orientation of the upper arm in the mount frame, which is the torso frame
rotated by `mount` in the description.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from tci.messages.frames import Array, rotation_y, rotation_z
from tci.robot.formulas import shoulder_of

Side = Literal["left", "right"]

JOINTS = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow_pitch", "elbow_yaw")
"""Names of the generic joints of an arm, by index."""

SEGMENTS = ("upper_arm", "forearm")
"""Segments of an arm, on which receptive fields are defined."""


def side_sign(side: Side) -> float:
    """Returns +1 for the left side, -1 for the right side."""
    return 1.0 if side == "left" else -1.0


def upper_arm_rotation(posture: Array, side: Side, *, axial: bool) -> Array:
    """Returns `R_MU` (..., 3, 3), the rotation of the upper arm in the mount frame M, at the generic angles
    `posture` (..., 5) [rad].

    In the upper arm's frame U, -z points along the segment and x to the segment's flexor side. If `axial` is
    False, internal rotation (joint 2) is left out. The angle theta of a taxel is measured in the frame
    without internal rotation.
    """
    s = side_sign(side)
    c0, c1, c2 = np.cos(posture[..., :3]).T
    s0, s1, s2 = np.sin(posture[..., :3]).T
    s1, s2 = s * s1, s * s2
    if not axial:
        c2, s2 = np.ones_like(c2), np.zeros_like(s2)
    # Ry(-pitch) Rx(s roll) Rz(-s yaw), written out for speed: it is computed for each command.
    return np.array(
        [
            [c0 * c2 + s0 * s1 * s2, -c1 * s2, s0 * c2 - c0 * s1 * s2],
            [c0 * s2 - s0 * s1 * c2, c1 * c2, s0 * s2 + c0 * s1 * c2],
            [-s0 * c1, -s1, c0 * c1],
        ]
    ).T


def shoulder_angles(R_MU: Array, side: Side) -> Array:
    """Returns the generic angles (3,) [rad] of an upper arm with the rotation `R_MU` (3, 3). This is the
    inverse of `upper_arm_rotation`.

    If the arm points straight to the side, pitch and yaw rotate about one line. In this case, pitch is set to
    0.
    """
    s = side_sign(side)
    # Python floats for speed: it is computed for each reading.
    (xx, xy, xz), (yx, yy, yz), (_, _, zz) = R_MU.tolist()
    return np.array(shoulder_of(xx, xy, xz, yx, yy, yz, zz, s))


def forearm_rotation(posture: Array, side: Side, *, axial: bool) -> Array:
    """Returns `R_MF` (3, 3), the rotation of the forearm in the mount frame M, at the generic angles
    `posture` (5,) [rad].

    In the forearm's frame F, -z points along the forearm to the hand. If `axial` is True, x points to the
    thumb side; if it is False, pronation (joint 4) is left out.
    """
    s = side_sign(side)
    rotation = upper_arm_rotation(posture, side, axial=True) @ rotation_y(-posture[3])
    return rotation @ rotation_z(-s * posture[4]) if axial else rotation


def segment_rotation(segment: str, posture: Array, side: Side, *, axial: bool = False) -> Array:
    """Returns the rotation `R_MS` (3, 3) of the segment `upper_arm` or `forearm` in the mount frame M. If
    `axial` is False, the segment's rotation about its own axis is left out."""
    rotation = {"upper_arm": upper_arm_rotation, "forearm": forearm_rotation}[segment]
    return rotation(posture, side, axial=axial)


def limb_coordinates(points_S: Array, length: float, side: Side) -> tuple[Array, Array]:
    """Returns the limb coordinates (u, theta) of points (..., 3) [m] in the frame S of a segment (eq. 4 on
    the generic limb).

    u is 0 at the proximal and 1 at the distal end of a segment `length` [m] long. On both sides of the body,
    theta [rad] is 0 on the flexor side, +pi/2 lateral, pi on the extensor side and -pi/2 medial.
    """
    u = -points_S[..., 2] / length
    theta = np.arctan2(side_sign(side) * points_S[..., 1], points_S[..., 0])
    return u, theta


def limb_direction(theta: float, side: Side) -> Array:
    """Returns the unit vector (3,) in the direction `theta` [rad] around a segment's axis, in the segment's
    frame S."""
    return np.array([np.cos(theta), side_sign(side) * np.sin(theta), 0.0])
