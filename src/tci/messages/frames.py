"""Rotations and transforms in the notation `R_AB`, `T_AB`, `p_AB`: frame B expressed in frame A.

Frames are right-handed; in the torso frame x points forward, y left, z up. Angles are in radians.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rotation_x(angle: float) -> Array:
    """Returns the rotation (3, 3) about x by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rotation_y(angle: float) -> Array:
    """Returns the rotation (3, 3) about y by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle: float) -> Array:
    """Returns the rotation (3, 3) about z by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def rotation_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Returns the rotation (3, 3) of URDF's `rpy` [rad]: about fixed x, then y, then z."""
    return rotation_z(yaw) @ rotation_y(pitch) @ rotation_x(roll)


def rpy_of(rotation: Array) -> tuple[float, float, float]:
    """Returns roll, pitch, yaw [rad] of a rotation (3, 3), the inverse of `rotation_rpy`. At a pitch of +-90
    degrees yaw is 0."""
    level = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], level))
    if level < 1e-9:
        return float(np.arctan2(-rotation[1, 2], rotation[1, 1])), pitch, 0.0
    roll = float(np.arctan2(rotation[2, 1], rotation[2, 2]))
    return roll, pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def transform(rotation: Array, position: Array) -> Array:
    """Returns the homogeneous transform (4, 4) of `rotation` (3, 3) and `position` (3,) [m]."""
    result = np.zeros((4, 4))
    result[:3, :3] = rotation
    result[:3, 3] = position
    result[3, 3] = 1.0
    return result


def invert(transform_AB: Array) -> Array:
    """Returns `T_BA` (4, 4) from `T_AB` (4, 4)."""
    rotation = transform_AB[:3, :3].T
    return transform(rotation, -rotation @ transform_AB[:3, 3])


def apply(transform_AB: Array, points_B: Array) -> Array:
    """Transforms points (..., 3) [m] from frame B to frame A."""
    result: Array = points_B @ transform_AB[:3, :3].T + transform_AB[:3, 3]
    return result


def angle_between(a: Array, b: Array) -> float:
    """Returns the angle [rad] between two vectors (3,). The result is also exact if the vectors are nearly
    parallel."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


def frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Makes an array read-only and returns it, without a copy. The caller must not keep another reference to
    the array."""
    values.setflags(write=False)
    return values


def doubles(values: NDArray[Any]) -> Array:
    """Converts numbers to doubles. NaN remains NaN; a signalling NaN raises no exception."""
    if values.dtype.kind != "f" or values.dtype.itemsize == 8:
        return values.astype(np.float64)
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def read_only(values: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """Returns a read-only copy of `values`, for messages between layers."""
    result = np.array(values, dtype=dtype)
    result.setflags(write=False)
    return result
