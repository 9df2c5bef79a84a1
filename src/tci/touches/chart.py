"""One patch of skin unrolled to a plane: points by their way along and around a limb, or on a sheet.

A hand moves in this plane; where there is no skin, it moves on as if the limb went on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.body.generic_body import GenericBody
from tci.messages import JointReading
from tci.messages.frames import Array, invert
from tci.robot.generic_arm import limb_direction
from tci.robot.joint_map import generic_posture
from tci.skin.surfaces import Surface
from tci.skin.triangulation import is_sheet
from tci.touches.places import Spot, axis_of, long_axis

_NEAR = 4


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """The plane of one patch, in the frame of its link."""

    surface: Surface
    tube: bool
    """True for skin around a limb; False for a sheet or for single taxels."""
    origin: Array
    axis: Array
    """Unit vector (3,) along the limb, away from the trunk."""
    first: Array
    """Unit vector (3,) at the angle 0 around the limb; on a sheet the outward normal."""
    second: Array
    """Unit vector (3,) at the angle pi/2; on a sheet the direction across."""
    along: Array
    """Way (n,) [m] along the axis of each taxel."""
    around: Array
    """Angle (n,) [rad] of each taxel; on a sheet the way across [m]."""
    height: Array
    """Distance (n,) [m] of each taxel from the axis; on a sheet its height over the plane."""
    length: float
    """Length [m] that a way from 0 to 1 has: of the limb's segment, or of the patch."""
    begin: float
    """Way [m] at 0."""

    def coordinates(self, point: Array) -> tuple[float, float, float]:
        """Way along, angle around (or way across) and height of a point (3,) [m]."""
        offset = point - self.origin
        x, a, b = float(offset @ self.axis), float(offset @ self.first), float(offset @ self.second)
        return (x, float(np.arctan2(b, a)), float(np.hypot(a, b))) if self.tube else (x, b, a)

    def points(self, along: Array, around: Array) -> tuple[Array, Array]:
        """Points (k, 3) [m] at ways `along` (k,) and angles or ways `around` (k,), and outward normals (k,
        3): interpolated between the nearest taxels, and beside the skin as high as these."""
        x, y = along[:, None] - self.along, around[:, None] - self.around
        if self.tube:
            y = (y - 2.0 * np.pi * np.rint(y / (2.0 * np.pi))) * self.height.mean()
        square = x * x + y * y + 1e-8
        count = min(_NEAR, square.shape[1])
        near = np.argpartition(square, count - 1, axis=1)[:, :count]
        weights = 1.0 / np.take_along_axis(square, near, axis=1)
        weights /= weights.sum(axis=1)[:, None]
        height = (weights * self.height[near]).sum(axis=1)
        normals = np.einsum("kn,kni->ki", weights, self.surface.normals[near])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if self.tube:
            out = np.cos(around)[:, None] * self.first + np.sin(around)[:, None] * self.second
            return self.origin + along[:, None] * self.axis + height[:, None] * out, normals
        across = around[:, None] * self.second + height[:, None] * self.first
        return self.origin + along[:, None] * self.axis + across, normals


def chart_of(body: GenericBody, spot: Spot, joints: JointReading) -> Chart:
    """The plane of the patch on which `spot` is."""
    surface = body.skin.surfaces[spot.place.patch]
    positions = surface.positions
    if len(positions) < 4 or is_sheet(surface.normals):
        return _sheet(surface, spot)
    part = body.robot.part(spot.part)
    if part.kind == "arm" and spot.segment:
        segment = part.segment(spot.segment)
        posture = generic_posture(body.robot, joints)[part.name]
        T_TS = body.skin.segment_pose(part.name, segment.name, joints, posture)
        T_LS = invert(body.skin.link_pose(surface.link, joints)) @ T_TS
        assert part.side is not None  # an arm always has a side
        first, second = (T_LS[:3, :3] @ limb_direction(a, part.side) for a in (0.0, np.pi / 2.0))
        return _tube(surface, T_LS[:3, 3], -T_LS[:3, 2], first, second, (0.0, segment.length))
    axis = axis_of(body, body.robot.patch(spot.place.patch))
    first = spot.place.n_L - (spot.place.n_L @ axis) * axis
    first = first / np.linalg.norm(first) if np.linalg.norm(first) > 0.1 else np.linalg.svd(axis[None])[2][1]
    middle = (positions.min(axis=0) + positions.max(axis=0)) / 2.0
    return _tube(surface, middle, axis, first, np.cross(axis, first), None)


def _tube(
    surface: Surface, origin: Array, axis: Array, first: Array, second: Array,
    ends: tuple[float, float] | None,
) -> Chart:  # fmt: skip
    offset = surface.positions - origin
    along, a, b = offset @ axis, offset @ first, offset @ second
    begin, end = (float(along.min()), float(along.max())) if ends is None else ends
    return Chart(
        surface,
        True,
        origin,
        axis,
        first,
        second,
        along,
        np.arctan2(b, a),
        np.hypot(a, b),
        end - begin,
        begin,
    )


def _sheet(surface: Surface, spot: Spot) -> Chart:
    normal = spot.place.n_L
    axis = long_axis(surface.positions) if len(surface.positions) > 1 else np.linalg.svd(normal[None])[2][1]
    axis = axis - (axis @ normal) * normal
    if np.linalg.norm(axis) < 0.1:
        axis = np.linalg.svd(normal[None])[2][1]
    axis = axis / np.linalg.norm(axis)
    second = np.cross(normal, axis)
    offset = surface.positions - spot.place.p_L
    along = offset @ axis
    return Chart(
        surface, False, spot.place.p_L, axis, normal, second, along, offset @ second, offset @ normal,
        float(np.ptp(along)), float(along.min()),
    )  # fmt: skip
