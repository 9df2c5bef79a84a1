"""Approximates a limb's skin by a truncated cone (eqs. 3-4 of the paper), fitted to the skin's taxels.

The approximation replaces a taxel's distance from the cone's axis by the cone's radius r(x), and keeps the
taxel's position x along the axis and its angle theta around the axis. The radial error of a taxel is its true
distance from the axis, minus r(x).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from mujoco.minimize import least_squares

from tci.errors import TciError
from tci.messages.frames import Array, apply, invert, read_only
from tci.robot.description import Robot
from tci.robot.generic_arm import segment_rotation
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.skin.surfaces import Surface

Freedom = Literal["none", "centre", "axis"]
"""Changes of the cone's axis that the fit may make. Length and radii are always fitted. "none": the axis is
fixed. "centre": the axis may move sideways. "axis": the axis may move sideways and tilt."""


@dataclass(frozen=True, slots=True, eq=False)
class ConeFit:
    """A truncated cone, and the distances of the taxels from this cone."""

    origin: Array
    """Centre (3,) [m] of the proximal end. The most proximal taxel determines the place of this end along the
    axis."""
    axis: Array
    """Unit vector (3,) from the proximal to the distal end."""
    length: float
    """Length [m] of the cone, from the most proximal to the most distal taxel."""
    r1: float
    """Radius [m] at the proximal end."""
    r2: float
    """Radius [m] at the distal end."""
    rms: float
    """Root mean square [m] of the radial errors of all taxels."""
    largest: float
    """Largest absolute value [m] of the radial errors of all taxels."""

    def radius(self, x: Array) -> Array:
        """Returns the cone's radius r(x) [m] at the positions `x` (...) [m] along the axis (eq. 3)."""
        return np.asarray(self.r1 + (self.r2 - self.r1) * np.asarray(x) / self.length)


def fit_cone(positions: Array, *, origin: Array, axis: Array, free: Freedom = "none") -> ConeFit:
    """Fits a cone to taxels at `positions` (n, 3) [m] by least squares.

    The initial axis of the cone is the line through `origin` (3,) [m] along `axis` (3,), which points
    distally. `free` determines how the fit may change the axis. With "none" the axis is fixed. With "centre"
    the axis may move sideways. With "axis" the axis may move sideways and tilt.

    Raises TciError if there are fewer than 6 taxels, or if all taxels lie in one plane perpendicular to the
    axis.
    """
    positions = np.asarray(positions, dtype=np.float64)
    if positions.ndim != 2 or positions.shape[1] != 3 or len(positions) < 6:
        raise TciError(f"a cone needs positions (n, 3) of at least 6 taxels; got shape {positions.shape}")
    direction = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    side = np.linalg.svd(direction[None])[2][1:]
    start = np.asarray(origin, dtype=np.float64)

    def line(shift: Array) -> tuple[Array, Array]:
        """Returns a point on the cone's axis, and the axis's direction, after a change of the axis. `shift`
        contains the change: two shifts sideways [m], then two tilts [rad]."""
        tilted = direction + (shift[2:] @ side if len(shift) == 4 else 0.0)
        return start + shift[:2] @ side, tilted / np.linalg.norm(tilted)

    def error(shift: Array) -> Array:
        along, distance = _along_and_distance(positions, *line(shift))
        return distance - _radii(along, distance)(along)

    def errors_of(shifts: Array) -> Array:
        return np.transpose([error(shift) for shift in shifts.T])

    shift, scale = np.zeros(2), np.array([0.01, 0.01, 0.1, 0.1])
    if free != "none":
        shift, _ = least_squares(shift, errors_of, x_scale=scale[:2], verbose=0)
    if free == "axis":
        shift, _ = least_squares(np.append(shift, (0.0, 0.0)), errors_of, x_scale=scale, verbose=0)
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
    """Fits a truncated cone (eq. 4 of the paper) to one patch, in the frame of the patch's link.

    The cone's axis is parallel to the limb segment. The fit may move the axis sideways, since few skins are
    centred on the axis through the joints. Raises TciError if the patch is on no limb.
    """
    origin, axis = limb_axis(robot, surface, kinematics)
    return fit_cone(surface.positions, origin=origin, axis=axis, free="centre")


def limb_axis(robot: Robot, surface: Surface, kinematics: KinematicChain) -> tuple[Array, Array]:
    """Returns a point (3,) [m] on the axis of a patch's limb segment, and the axis's distal direction (3,).

    Point and direction are in the frame of the patch's link. Raises TciError if the patch is on no limb.
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
    """Returns two distances (n,) [m] of points: along an axis, measured from `point`, and from the axis. The
    unit vector `axis` gives its direction."""
    relative = positions - point
    along = relative @ axis
    return along, np.linalg.norm(relative - along[:, None] * axis, axis=1)


def _radii(along: Array, distance: Array) -> np.polynomial.Polynomial:
    """Fits a straight line r(x), the radius of a cone, to taxels by least squares. `along` (n,) [m] are the
    taxels' positions x along the axis, `distance` (n,) [m] their distances from it."""
    return np.polynomial.Polynomial.fit(along, distance, 1)
