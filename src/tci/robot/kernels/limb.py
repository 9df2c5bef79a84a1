"""Poses of links in the frame S of a limb segment, for compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np

from tci.messages.frames import Array
from tci.robot import formulas
from tci.robot.description import GenericPart, Segment
from tci.robot.generic_arm import SEGMENTS, side_sign
from tci.support.compiled import inlined
from tci.support.one_source import made_with

Vector = tuple[float, float, float]
Row = tuple[float, float, float, float]
_axes = made_with(inlined, formulas).segment_axes

LIMB = np.dtype(
    [
        ("R_TM", np.float64, (3, 3)), ("origin", np.float64, (3,)), ("length", np.float64),
        ("side", np.float64), ("segment", np.float64),
    ]
)  # fmt: skip
"""A limb segment: rotation of the limb's mount in the torso frame, origin [m] of the segment in the frame of
its link, length [m], side (+1 left, -1 right), and index in SEGMENTS (0 upper arm, 1 forearm)."""


def limb_record(part: GenericPart, segment: Segment) -> tuple[Any, ...]:
    """The values of a LIMB."""
    assert part.side is not None  # as `Robot.limb_segment` says
    side, number = side_sign(part.side), SEGMENTS.index(segment.name)
    return part.R_TM, segment.origin, segment.length, side, number


@inlined
def limb_pose(T_TL: Array, T_TG: Array, limb: Any, posture: Array) -> tuple[Row, Row, Row]:
    """Returns three rows (3, 4) of the pose T_SL of a link in the frame S of a limb's segment. `T_TL` (4, 4)
    is the pose of the link in the torso frame T.

    `T_TG` (4, 4) is the pose of the link that carries the segment, also in the torso frame. `limb` is
    the LIMB of the segment. `posture` (4,) [rad] are the first
    four generic angles of the arm.
    """
    a, b, c, d, e, f, g, h, i = _axes(posture[0], posture[1], posture[2], posture[3], limb.side, limb.segment)
    x, y, z = (a, b, c), (d, e, f), (g, h, i)
    p = _origin(T_TL, T_TG, limb, 0), _origin(T_TL, T_TG, limb, 1), _origin(T_TL, T_TG, limb, 2)
    return _row(T_TL, limb, x, p), _row(T_TL, limb, y, p), _row(T_TL, limb, z, p)


@inlined
def _origin(T_TL: Array, T_TG: Array, limb: Any, k: int) -> float:
    """Returns one component [m] of the vector from the origin of a limb segment to the origin of a link, in
    the torso frame: x, y or z for `k` 0, 1 or 2."""
    p = T_TL[k, 3] - T_TG[k, 3]
    for axis in range(3):
        p -= T_TG[k, axis] * limb.origin[axis]
    return p


@inlined
def _row(T_TL: Array, limb: Any, axis: Vector, p: Vector) -> Row:
    """Returns one row (4,) of the pose T_SL (3, 4) of a link in the frame S of a limb segment. The row
    belongs to `axis` (3,), an axis of S given in the frame of the limb's mount. `p` (3,) [m] is the vector
    from the origin of S to that of the link, in the torso frame."""
    R = limb.R_TM
    a = R[0, 0] * axis[0] + R[0, 1] * axis[1] + R[0, 2] * axis[2]
    b = R[1, 0] * axis[0] + R[1, 1] * axis[1] + R[1, 2] * axis[2]
    c = R[2, 0] * axis[0] + R[2, 1] * axis[1] + R[2, 2] * axis[2]
    return (
        a * T_TL[0, 0] + b * T_TL[1, 0] + c * T_TL[2, 0],
        a * T_TL[0, 1] + b * T_TL[1, 1] + c * T_TL[2, 1],
        a * T_TL[0, 2] + b * T_TL[1, 2] + c * T_TL[2, 2],
        a * p[0] + b * p[1] + c * p[2],
    )
