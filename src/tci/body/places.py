"""Converts places (u, theta) of the generic limb to points of a robot's own skin, in the frame of a link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.errors import TciError
from tci.messages import JointReading
from tci.messages.frames import Array, apply, invert, read_only
from tci.robot.generic_arm import limb_direction
from tci.robot.joint_map import generic_posture
from tci.skin.skin import Skin
from tci.skin.surfaces import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A point of the skin."""

    patch: str
    """Name of the patch."""
    p_L: Array
    """Position (3,) [m] in the frame of the patch's link."""
    n_L: Array
    """Outward unit normal (3,) of the skin at `p_L`, in the frame of the patch's link."""


def find_place(skin: Skin, part: str, segment: str, u: float, theta: float, joints: JointReading) -> Place:
    """Returns the point of the skin at (u, theta) of a limb segment, in the posture `joints`.

    A ray starts on the segment's axis at `u`, in direction `theta` [rad]. The result is the point at which
    the ray leaves the skin. Raises TciError if there is no skin at this place or the part is not an arm, and
    UnknownNameError for an unknown part or segment.
    """
    robot = skin.robot
    generic_part = robot.part(part)
    length = generic_part.segment(segment).length
    T_TS = skin.segment_pose(part, segment, joints, generic_posture(robot, joints)[part])
    origin_S = np.array([0.0, 0.0, -u * length])
    assert generic_part.side is not None  # an arm always has a side
    direction_S = limb_direction(theta, generic_part.side)
    best: tuple[float, Place] | None = None
    for patch in robot.patches:
        if (patch.part, patch.segment) != (part, segment):
            continue
        T_LS = invert(skin.link_pose(patch.link, joints)) @ T_TS
        origin, direction = apply(T_LS, origin_S), T_LS[:3, :3] @ direction_S
        reach = leave_surface(skin.surfaces[patch.name], origin, direction)
        if reach is not None and (best is None or reach > best[0]):
            points, normals = skin.surfaces[patch.name].project((origin + reach * direction)[None])
            best = reach, Place(patch.name, read_only(points[0]), read_only(normals[0]))
    if best is None:
        raise TciError(f"{robot.name} has no skin on {part}'s {segment} at u={u:g}, theta={theta:g} rad")
    return best[1]


def leave_surface(surface: Surface, origin: Array, direction: Array) -> float | None:
    """Returns the distance [m] along a ray to its last intersection with a surface; None if there is none.

    All faces are tested at once (Moeller and Trumbore 1997).
    """
    a, b, c = (surface.positions[surface.faces[:, corner]] for corner in range(3))
    edge1, edge2, offset = b - a, c - a, origin - a
    p = np.cross(direction, edge2)
    q = np.cross(offset, edge1)
    determinant = np.einsum("ij,ij->i", edge1, p)
    with np.errstate(divide="ignore", invalid="ignore"):
        v = np.einsum("ij,ij->i", offset, p) / determinant
        w = q @ direction / determinant
        reach = np.einsum("ij,ij->i", edge2, q) / determinant
    # A ray parallel to a face has no intersection: values that are not finite become -1, a miss.
    v, w, reach = np.nan_to_num([v, w, reach], nan=-1.0, posinf=-1.0, neginf=-1.0)
    margin = 1e-9  # rounding must not let a ray through an edge pass between two faces
    hit = (v >= -margin) & (w >= -margin) & (v + w <= 1.0 + margin) & (reach > 0.0)
    return float(reach[hit].max()) if hit.any() else None
