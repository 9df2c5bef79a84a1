"""Computes Denavit-Hartenberg parameters of a chain of servos from the model's joint axes.

    T_TL = base Rz(theta_1) Tz(d_1) Tx(a_1) Rx(alpha_1) Rz(theta_2) ... Rz(theta_n) Tz(d_n) tool

Classic rows (Denavit and Hartenberg 1955) group each joint with the common normal after it, modified ones
(Craig, Introduction to Robotics, ch. 3) with the one before it. Base and tool are equal in both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tci.errors import CommandError
from tci.frames import Array, invert, read_only, rotation_x, rotation_z, transform
from tci.robot.kinematics import KinematicChain

_PARALLEL = 1e-9
"""Sine of the angle between two axes below which they count as parallel. Assumed: far above rounding error
(1e-16), far below any angle by design."""
_COINCIDENT = 1e-12
"""Distance [m] between parallel axes below which they count as one. Assumed: above rounding error for robots
of metres, below any distance by design."""

Convention = Literal["classic", "modified"]


@dataclass(frozen=True, slots=True)
class DenavitHartenberg:
    """A chain as DH parameters: a table, and the fixed transforms before and after it."""

    convention: Convention
    """`classic`: Rz(theta) Tz(d) Tx(a) Rx(alpha) per row. `modified`: Rx(alpha) Tx(a) Rz(theta) Tz(d)."""
    servos: tuple[int, ...]
    """Indices into `Robot.servos`, from the torso on."""
    a: Array
    """Length of the common normal (n,) [m]."""
    alpha: Array
    """Twist (n,) [rad]."""
    d: Array
    """Offset along the joint's axis (n,) [m]."""
    theta: Array
    """Angle (n,) [rad] at which the servo reads zero: a joint turns by theta + q."""
    base: Array
    """Pose (4, 4) of the first frame in the torso frame."""
    tool: Array
    """Pose (4, 4) of the link in the last frame."""

    def pose(self, position: Array) -> Array:
        """Returns `T_TL` (4, 4), the product of the table, at `position` (n_servos,) [rad] of all servos."""
        result = self.base
        rows = zip(self.servos, self.a, self.alpha, self.d, self.theta, strict=True)
        for servo, a, alpha, d, theta in rows:
            turn = transform(rotation_z(theta + position[servo]), np.array([0.0, 0.0, d]))
            link = transform(rotation_x(alpha), np.array([a, 0.0, 0.0]))
            result = result @ turn @ link if self.convention == "classic" else result @ link @ turn
        return result @ self.tool


def denavit_hartenberg(
    kinematics: KinematicChain, link: str, *, convention: Convention = "classic"
) -> DenavitHartenberg:
    """Computes DH parameters of the servos between torso and `link`.

    Parallel axes have many common normals; the one without offset d is used. Raises UnknownNameError for an
    unknown link, CommandError if no servo moves the link, for a prismatic joint, or for an unknown
    convention.
    """
    if convention not in ("classic", "modified"):
        raise CommandError(f"DH convention {convention!r}; valid: classic, modified")
    servos = kinematics.chain(link)
    if not servos:
        raise CommandError(f"no servo moves {link!r} relative to the torso; valid: a link of a limb or head")
    T_TL, points, axes = _axes(kinematics, link, servos)
    n = len(servos)
    a, alpha, d, theta = np.zeros((4, n))
    origin, x = points[0], _perpendicular(axes[0])
    base = np.eye(4)
    for i in range(n):
        if i + 1 < n:
            near, far, normal = _common_normal(points[i], axes[i], points[i + 1], axes[i + 1], origin, x)
        else:
            near, far, normal = origin, origin, x
        if i == 0:
            origin, x = near, normal
            base = _frame(x, axes[0], origin)
        d[i] = (near - origin) @ axes[i]
        theta[i] = _angle(x, normal, axes[i])
        if i + 1 < n:
            a[i] = (far - near) @ normal
            alpha[i] = _angle(axes[i], axes[i + 1], normal)
        origin, x = far, normal
    tool = invert(_frame(x, axes[-1], origin)) @ T_TL
    if convention == "modified":
        a, alpha = np.roll(a, 1), np.roll(alpha, 1)
    return DenavitHartenberg(
        convention,
        servos,
        *(read_only(values) for values in (a, alpha, d, theta, base, tool)),
    )


def _axes(kinematics: KinematicChain, link: str, servos: tuple[int, ...]) -> tuple[Array, Array, Array]:
    """Returns `T_TL`, points on the servos' axes (n, 3) and their directions (n, 3) in T, with servos at
    zero."""
    position = np.zeros(kinematics.n_servos)
    T_TL, jacobian = kinematics.pose_and_jacobian(position, link)
    linear, axes = jacobian[:3, servos].T, jacobian[3:, servos].T
    if not np.allclose(np.linalg.norm(axes, axis=1), 1.0):
        raise CommandError(f"a joint between the torso and {link!r} does not turn; valid: hinges only")
    # linear = axis x (p - point): this gives the point of the axis nearest to p, the link's origin.
    return T_TL, T_TL[:3, 3] + np.cross(axes, linear), axes


def _common_normal(
    p: Array, u: Array, q: Array, v: Array, origin: Array, x: Array
) -> tuple[Array, Array, Array]:
    """Returns the feet (3,) of the common normal on the lines p + s u and q + t v, and its direction (3,).

    For parallel lines it passes through `origin`, a point of the first line; for coincident ones its
    direction is `x`.
    """
    cross = np.cross(u, v)
    sine = float(np.linalg.norm(cross))
    if sine > _PARALLEL:
        s = np.linalg.det(np.array([q - p, v, cross])) / sine**2
        t = np.linalg.det(np.array([q - p, u, cross])) / sine**2
        return p + s * u, q + t * v, cross / sine
    foot = q + ((origin - q) @ v) * v
    across = foot - origin
    across -= (across @ u) * u
    distance = float(np.linalg.norm(across))
    return origin, foot, across / distance if distance > _COINCIDENT else x


def _perpendicular(z: Array) -> Array:
    """Returns a unit vector (3,) perpendicular to z."""
    across: Array = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    across /= np.linalg.norm(across)
    return across


def _angle(a: Array, b: Array, about: Array) -> float:
    """Returns the angle [rad] from a to b, turning about `about`."""
    return float(np.arctan2(np.cross(a, b) @ about, a @ b))


def _frame(x: Array, z: Array, origin: Array) -> Array:
    """Returns the frame (4, 4) with the given x and z axes and origin."""
    return transform(np.column_stack([x, np.cross(z, x), z]), origin)
