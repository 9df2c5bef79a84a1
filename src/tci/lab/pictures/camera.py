"""Camera without distortion: converts pixels to rays, and points to pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import TciError
from tci.messages.frames import Array, apply, invert, read_only, transform

_NEAREST = 1e-3
"""Least distance [m] between the points and the camera that `fit` returns, along the camera's axis. Assumed:
with this distance, rounding errors move no point behind the camera."""
_HALVINGS = 60


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """Pinhole camera. The axes of the camera frame C are: x to the right, y down, z into the picture."""

    T_WC: Array
    """Pose (4, 4) of the camera frame C in the world frame W. All rays start at the origin of C."""
    fov: float
    """Vertical angle of view [rad]."""
    width: int
    """Width of the picture [pixels]."""
    height: int
    """Height of the picture [pixels]."""

    @property
    def focal(self) -> float:
        """Focal length [pixels]."""
        return float(self.height / (2.0 * np.tan(self.fov / 2.0)))


def check_size(width: int, height: int) -> None:
    """Raises TciError for a picture without pixels."""
    if width < 1 or height < 1:
        raise TciError(f"picture of {width} x {height} pixels; valid: at least 1 x 1")


def look_at(
    point: ArrayLike,
    *,
    azimuth: float,
    elevation: float,
    distance: float,
    fov: float = 0.6,
    width: int = 600,
    height: int = 600,
    frame: Array | None = None,
) -> Camera:
    """Returns a camera that looks at `point` (3,) [m] from the distance `distance` [m].

    The camera's direction from the point is given by `azimuth` [rad], an angle around z that is 0 in front
    (x) and +pi/2 on the left (y), and by `elevation` [rad], the angle above the horizontal plane. The point,
    the angles and the picture's upward direction are given in the frame `T_WF` (4, 4), by default in the
    world frame. Raises TciError for a distance, angle or size with which no picture is possible.
    """
    if not distance > 0.0:
        raise TciError(f"camera distance {distance} m; valid: more than 0")
    if not 0.0 < fov < np.pi:
        raise TciError(f"camera angle of view {fov} rad; valid: between 0 and pi")
    if not abs(elevation) < np.pi / 2:
        raise TciError(f"camera elevation {elevation} rad; valid: between -pi/2 and pi/2")
    check_size(width, height)
    outward = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    rotation = np.stack([right, np.cross(-outward, right), -outward], axis=1)
    T_FC = transform(rotation, np.asarray(point, dtype=float) + distance * outward)
    T_WC = T_FC if frame is None else frame @ T_FC
    return Camera(T_WC=read_only(T_WC), fov=fov, width=width, height=height)


def fit(
    points: Array,
    *,
    azimuth: float,
    elevation: float,
    margin: float = 0.04,
    fov: float = 0.4,
    width: int = 600,
    height: int = 600,
    frame: Array | None = None,
) -> Camera:
    """Returns the camera that shows all `points` (n, 3) [m] of the world as large as possible.

    A fraction `margin` of the picture stays free on each side. The other arguments and the errors are those
    of `look_at`.
    """
    camera = look_at(
        (0.0, 0.0, 0.0), azimuth=azimuth, elevation=elevation, distance=1.0,
        fov=fov, width=width, height=height, frame=frame,
    )  # fmt: skip
    R_WC = camera.T_WC[:3, :3]
    points_C = points @ R_WC
    sides, depth = points_C[:, :2], points_C[:, 2]
    slope = np.array([width, height]) * (0.5 - margin) / camera.focal
    # All points are between the four side planes of the view: x - x0 <= slope (z - z0), and so on.
    far = depth[:, None] * slope
    back = -((sides - far).max(axis=0) + (-sides - far).max(axis=0)) / (2.0 * slope)
    z = min(float(back.min()), float(depth.min()) - _NEAREST)
    place = [_middle(sides[:, axis], depth - z) for axis in range(2)]
    return replace(camera, T_WC=read_only(transform(R_WC, R_WC @ np.array([*place, z]))))


def _middle(sides: Array, depth: Array) -> float:
    """Returns the sideways position [m] of the camera with which points are in the middle of the picture.
    `sides` (n,) [m] are the sideways positions of the points, and `depth` (n,) [m] their distances along the
    camera's axis."""
    low, high = float(sides.min()), float(sides.max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        seen = (sides - middle) / depth
        low, high = (middle, high) if seen.max() > -seen.min() else (low, middle)
    return (low + high) / 2.0


def pixel_centres(camera: Camera) -> Array:
    """Returns the centres (height * width, 2) [pixels] of all pixels, row by row. The axis x is to the right,
    y down."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def rays(camera: Camera, pixels: Array) -> Array:
    """Returns the unit directions (n, 3) of the rays through `pixels` (n, 2), in the world frame."""
    centre = np.array([camera.width, camera.height]) / 2.0
    direction_C = np.ones((len(pixels), 3))
    direction_C[:, :2] = (pixels - centre) / camera.focal
    direction_C /= np.linalg.norm(direction_C, axis=1, keepdims=True)
    direction_W: Array = direction_C @ camera.T_WC[:3, :3].T
    return direction_W


def project(camera: Camera, points: Array) -> tuple[Array, Array]:
    """Projects points (n, 3) [m] of the world. Returns the pixels (n, 2) and the depths (n,) [m].

    Depth is measured along the camera's axis. The pixel is NaN for a point that is behind the camera or in
    the camera's plane (depth <= 0).
    """
    points_C = apply(invert(camera.T_WC), points)
    depth = points_C[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = points_C[:, :2] * camera.focal / depth[:, None]
    pixels += np.array([camera.width, camera.height]) / 2.0
    pixels[depth <= 0.0] = np.nan
    return pixels, depth
