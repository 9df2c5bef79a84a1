"""Where a segment's frame S is, for the compiled loops."""

from __future__ import annotations

import numpy as np

from tci.frames import Array
from tci.interface.kernels.compiled import inlined
from tci.model.description import GenericPart, Segment
from tci.model.generic_arm import SEGMENTS, side_sign


def limb_numbers(part: GenericPart, segment: Segment) -> Array:
    """A segment in numbers (15,): R_TM (9), origin in its link (3), length [m], side, place in SEGMENTS."""
    assert part.side is not None  # as `Robot.limb_segment` says
    place = [segment.length, side_sign(part.side), SEGMENTS.index(segment.name)]
    return np.concatenate([part.R_TM.ravel(), segment.origin, place])


@inlined
def limb_pose(T_TL: Array, T_TG: Array, limb: Array, posture: Array, T_SL: Array, R: Array) -> None:
    """Write `T_SL` (4, 4) of a link at `T_TL`, seen from the frame S that `segment_pose` gives a segment.

    `T_TG` (4, 4) is the pose of the segment's own link, `limb` (15,) its numbers, `posture` (5,) [rad]; `R`
    (3, 3) is room to work in.
    """
    R_TM, origin, side = limb[:9].reshape(3, 3), limb[9:12], limb[13]
    # R_MS of `segment_rotation`, axial=False, as products of rotations about y, x, z and y.
    c0, s0 = np.cos(posture[0]), -np.sin(posture[0])
    c1, s1 = np.cos(side * posture[1]), np.sin(side * posture[1])
    R[0, 0], R[0, 1], R[0, 2] = c0, s0 * s1, s0 * c1
    R[1, 0], R[1, 1], R[1, 2] = 0.0, c1, -s1
    R[2, 0], R[2, 1], R[2, 2] = -s0, c0 * s1, c0 * c1
    if limb[14] > 0.0:
        c2, s2 = np.cos(side * posture[2]), -np.sin(side * posture[2])
        c3, s3 = np.cos(posture[3]), -np.sin(posture[3])
        for row in range(3):
            x = R[row, 0] * c2 + R[row, 1] * s2
            y = R[row, 1] * c2 - R[row, 0] * s2
            z = R[row, 2]
            R[row, 0], R[row, 1], R[row, 2] = x * c3 - z * s3, y, x * s3 + z * c3
    for row in range(3):
        for column in range(4):
            T_SL[row, column] = 0.0
    for k in range(3):
        p = T_TL[k, 3] - T_TG[k, 3]
        for axis in range(3):
            p -= T_TG[k, axis] * origin[axis]
        for row in range(3):
            r = R_TM[k, 0] * R[0, row] + R_TM[k, 1] * R[1, row] + R_TM[k, 2] * R[2, row]
            for column in range(3):
                T_SL[row, column] += r * T_TL[k, column]
            T_SL[row, 3] += r * p
    T_SL[3, 0] = T_SL[3, 1] = T_SL[3, 2] = 0.0
    T_SL[3, 3] = 1.0
