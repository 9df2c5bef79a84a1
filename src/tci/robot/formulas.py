"""Rotations and shoulders as scalar functions in plain Python, which numba and Warp compile as they are
(`tci.support.one_source`)."""

from __future__ import annotations

from math import asin, atan2, cos, sin

SIDEWAYS = 1e-9
"""The upper arm counts as pointing straight to the side if the cosine of its abduction angle is below this
number."""


def shoulder_of(
    xx: float, xy: float, xz: float, yx: float, yy: float, yz: float, zz: float, side: float
) -> tuple[float, float, float]:
    """Generic angles [rad] of an upper arm whose rotation R_MU has the elements `xx` to `zz`; `side` is +1 on
    the left. An arm straight to the side has the pitch 0."""
    sideways = xz * xz + zz * zz < SIDEWAYS * SIDEWAYS
    pitch = 0.0 if sideways else atan2(-xz, zz)
    yaw = atan2(-xy, xx) if sideways else atan2(yx, yy)
    return pitch, side * asin(max(min(-yz, 1.0), -1.0)), -side * yaw


def turned(
    x: float, y: float, z: float, ax: float, ay: float, az: float, angle: float
) -> tuple[float, float, float]:
    """The vector (x, y, z) turned by `angle` [rad] about the unit vector (ax, ay, az) (Rodrigues)."""
    s, c = sin(angle), cos(angle)
    along = (1.0 - c) * (ax * x + ay * y + az * z)
    return (
        c * x + s * (ay * z - az * y) + along * ax,
        c * y + s * (az * x - ax * z) + along * ay,
        c * z + s * (ax * y - ay * x) + along * az,
    )


def segment_axes(
    pitch: float, roll: float, yaw: float, elbow: float, side: float, segment: float
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Axes x, y and z of a limb's segment (0 upper arm, 1 forearm) in the frame of the limb's mount, for the
    first four generic angles [rad]: R_MS of `segment_rotation`, axial=False. `side` is +1 on the left; on the
    right, y points to the other side."""
    # Products of rotations about y, x, z and y.
    c0, s0 = cos(pitch), -sin(pitch)
    c1, s1 = cos(side * roll), sin(side * roll)
    if segment == 0.0:
        return c0, 0.0, -s0, s0 * s1, c1, c0 * s1, s0 * c1, -s1, c0 * c1
    c, s = cos(side * yaw), -sin(side * yaw)
    xx, xy, xz = c0 * c + s0 * s1 * s, c1 * s, c0 * s1 * s - s0 * c
    d, e = cos(elbow), sin(elbow)
    return (
        xx * d + s0 * c1 * e, xy * d - s1 * e, xz * d + c0 * c1 * e,
        s0 * s1 * c - c0 * s, c1 * c, c0 * s1 * c + s0 * s,
        s0 * c1 * d - xx * e, -s1 * d - xy * e, c0 * c1 * d - xz * e,
    )  # fmt: skip
