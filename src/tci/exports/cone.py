"""The paper's approximation of a limb's skin: a truncated cone (eqs 3-4), fitted to its taxels.

The place x of a taxel along the axis and its angle theta around it are kept; its distance from the axis is
replaced by the cone's radius r(x). The error is the difference of the two distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tci.errors import TciError
from tci.frames import Array, apply, invert, read_only
from tci.robot.description import Robot
from tci.robot.generic_arm import segment_rotation
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.skin.surfaces import Surface

Freedom = Literal["none", "centre", "axis"]
"""Degrees of freedom of the fit besides length and radii: none, the axis' position sideways ("centre"), or
its direction too ("axis")."""


@dataclass(frozen=True, slots=True, eq=False)
class ConeFit:
    """A truncated cone and the distances of the taxels from it."""

    origin: Array
    """Centre (3,) [m] of the proximal end, at the first taxel."""
    axis: Array
    """Unit vector (3,) from the proximal to the distal end."""
    length: float
    """Length [m], up to the last taxel."""
    r1: float
    """Radius [m] at the proximal end."""
    r2: float
    """Radius [m] at the distal end."""
    rms: float
    """Root mean square of the radial error [m]."""
    largest: float
    """Largest radial error [m]."""

    def radius(self, x: Array) -> Array:
        """Returns r(x) [m] at `x` (...) [m] along the axis (eq. 3)."""
        return np.asarray(self.r1 + (self.r2 - self.r1) * np.asarray(x) / self.length)


def fit_cone(positions: Array, *, origin: Array, axis: Array, free: Freedom = "none") -> ConeFit:
    """Fits a cone to taxels at `positions` (n, 3) [m] by least squares.

    The axis starts as the line through `origin` (3,) [m] along `axis` (3,), which points distally. With
    `free` "none" it stays there, with "centre" it may move sideways, with "axis" it may tilt as well. Raises
    TciError for fewer than 6 taxels or taxels that lie in one plane across the axis.
    """
    from scipy.optimize import least_squares  # takes 11 MB, and most programs fit nothing

    positions = np.asarray(positions, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3 or len(positions) < 6:
        raise TciError(f"a cone needs positions (n, 3) of at least 6 taxels; got shape {positions.shape}")
    direction = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    side = np.linalg.svd(direction[None])[2][1:]
    start = np.asarray(origin, dtype=np.float64)

    def line(shift: Array) -> tuple[Array, Array]:
        """Returns point and direction of the axis after `shift`: two shifts sideways [m], then two tilts
        [rad]."""
        tilted = direction + (shift[2:] @ side if len(shift) == 4 else 0.0)
        return start + shift[:2] @ side, tilted / np.linalg.norm(tilted)

    def error(shift: Array) -> Array:
        along, distance = _along_and_distance(positions, *line(shift))
        return distance - _radii(along, distance)(along)

    shift = np.zeros(2)
    if free != "none":
        shift = least_squares(error, shift, x_scale=0.01).x
    if free == "axis":
        shift = least_squares(error, np.append(shift, (0.0, 0.0)), x_scale=[0.01, 0.01, 0.1, 0.1]).x
    point, axis = line(shift)
    along, distance = _along_and_distance(positions, point, axis)
    first, last = float(along.min()), float(along.max())
    if last - first < 1e-6:
        raise TciError("a cone needs taxels at different places along its axis; these lie in one plane")
    radius = _radii(along, distance)
    errors = distance - radius(along)
    return ConeFit(
        origin=read_only(point + first * axis),
        axis=read_only(axis),
        length=last - first,
        r1=float(radius(first)),
        r2=float(radius(last)),
        rms=float(np.sqrt(np.mean(errors**2))),
        largest=float(np.abs(errors).max()),
    )


def cone_of(robot: Robot, surface: Surface, kinematics: KinematicChain) -> ConeFit:
    """Fits the paper's approximation (eq. 4) to one patch, in its link. The axis is parallel to the segment
    and may move sideways, since few skins are centred on their joints.

    Raises TciError for a patch that is on no limb.
    """
    origin, axis = limb_axis(robot, surface, kinematics)
    return fit_cone(surface.positions, origin=origin, axis=axis, free="centre")


def limb_axis(robot: Robot, surface: Surface, kinematics: KinematicChain) -> tuple[Array, Array]:
    """Returns a point (3,) [m] on the axis of a patch's segment and its distal direction (3,), in the link.

    Raises TciError for a patch that is on no limb.
    """
    patch = robot.patch(surface.patch)
    part = robot.part(patch.part)
    segment = robot.limb_segment(patch)
    if segment is None or part.side is None:
        raise TciError(f"skin patch {patch.name!r} is on no generic limb, so no cone fits it")
    poses = kinematics.poses(initial_position(robot), [patch.link, segment.link])
    R_TS = part.R_TM @ segment_rotation(segment.name, part.initial_posture, part.side)
    T_LT = invert(poses[patch.link])
    origin = apply(T_LT, apply(poses[segment.link], np.array(segment.origin)))
    return origin, -T_LT[:3, :3] @ R_TS[:, 2]


def _along_and_distance(positions: Array, point: Array, axis: Array) -> tuple[Array, Array]:
    """Returns place (n,) along the axis and distance (n,) from it, both [m]."""
    relative = positions - point
    along = relative @ axis
    return along, np.linalg.norm(relative - along[:, None] * axis, axis=1)


def _radii(along: Array, distance: Array) -> np.polynomial.Polynomial:
    """Fits the straight line distance = r(along) by least squares."""
    return np.polynomial.Polynomial.fit(along, distance, 1)
