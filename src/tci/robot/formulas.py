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
