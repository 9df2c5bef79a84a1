"""Computes Denavit-Hartenberg parameters of a chain of servos from the model's joint axes.

    T_TL = base Rz(theta_1) Tz(d_1) Tx(a_1) Rx(alpha_1) Rz(theta_2) ... Rz(theta_n) Tz(d_n) tool

A classic row (Denavit and Hartenberg 1955) contains a joint and the common normal after this joint. A
modified row (Craig, Introduction to Robotics, ch. 3) contains a joint and the common normal before this
joint. Base and tool are equal in both conventions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from tci.errors import CommandError
from tci.messages.frames import Array, invert, read_only, rotation_x, rotation_z, transform
from tci.robot.kinematics import KinematicChain

_PARALLEL = 1e-9
"""Two axes count as parallel if the sine of the angle between them is below this number. Assumed: it is far
above the rounding error (1e-16) and far below every angle in a robot's design."""
_COINCIDENT = 1e-12
"""Parallel axes count as coincident if their distance [m] is below this number. Assumed: it is above the
rounding error for robots of a few metres, and below every distance in a robot's design."""

Convention = Literal["classic", "modified"]


@dataclass(frozen=True, slots=True)
class DenavitHartenberg:
    """DH parameters of a chain: a table, and the fixed transforms before and after the table."""

    convention: Convention
    """Convention, which defines the transform of one row. `classic`: Rz(theta) Tz(d) Tx(a) Rx(alpha).
    `modified`: Rx(alpha) Tx(a) Rz(theta) Tz(d)."""
    servos: tuple[int, ...]
    """Indices of the chain's servos in `Robot.servos`, in order from the torso."""
    a: Array
    """DH parameter a (n,) [m] of each row: length of the common normal of two successive joint axes."""
    alpha: Array
    """DH parameter alpha (n,) [rad] of each row: angle between two successive joint axes."""
    d: Array
    """DH parameter d (n,) [m] of each row: offset along the joint's axis."""
    theta: Array
    """DH parameter theta (n,) [rad] of each row: joint angle with the servo at zero. With the servo at q, the
    joint angle is theta + q."""
    base: Array
    """Pose (4, 4) of the table's first frame, in the torso frame."""
    tool: Array
    """Pose (4, 4) of the link at the end of the chain, in the table's last frame."""

    def pose(self, position: Array) -> Array:
        """Returns the pose `T_TL` (4, 4) of the link in the torso frame, with the servos at `position`
        (n_servos,) [rad]."""
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
    """Computes the DH parameters of the chain of servos from the torso to `link`.

    Two parallel axes have many common normals. In this case, the common normal with d = 0 is used.

    Raises UnknownNameError if the link does not exist. Raises CommandError if no servo moves the link, if the
    chain has a prismatic joint, or if the convention is unknown.
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
    """Returns the link's pose `T_TL` (4, 4) in the torso frame, and for n servos a point on each axis (n, 3)
    [m] and its direction (n, 3).

    Points and directions are in the torso frame, with all servos at zero. Raises CommandError if a joint is
    not a hinge.
    """
    position = np.zeros(kinematics.n_servos)
    T_TL, jacobian = kinematics.pose_and_jacobian(position, link)
    linear, axes = jacobian[:3, servos].T, jacobian[3:, servos].T
    if not np.allclose(np.linalg.norm(axes, axis=1), 1.0):
        raise CommandError(f"a joint between the torso and {link!r} does not turn; valid: hinges only")
    # linear = axis x (p - point). The solution is the point of the axis nearest to p, the link's origin.
    return T_TL, T_TL[:3, 3] + np.cross(axes, linear), axes


def _common_normal(
    p: Array, u: Array, q: Array, v: Array, origin: Array, x: Array
) -> tuple[Array, Array, Array]:
    """Returns the common normal of two lines, p + s u and q + t v: its end point (3,) on each line, and its
    direction (3,).

    If the lines are parallel, the normal passes through `origin`, a point on the first line. If they
    coincide, its direction is `x`.
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
    """Returns the angle [rad] of the rotation about `about` that turns the direction `a` into `b`."""
    return float(np.arctan2(np.cross(a, b) @ about, a @ b))


def _frame(x: Array, z: Array, origin: Array) -> Array:
    """Returns the pose (4, 4) of the frame with the given origin and the given directions of its x and z
    axes."""
    return transform(np.column_stack([x, np.cross(z, x), z]), origin)
