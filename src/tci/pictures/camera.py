"""A camera without distortion: maps pixels to rays and points to pixels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import TciError
from tci.frames import Array, apply, invert, read_only, transform

_NEAREST = 1e-3
"""Least depth [m] of the points that a fitted picture shows. Assumed: keeps them in front of the camera."""
_HALVINGS = 60


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera. Camera frame C: x to the right, y down, z into the picture."""

    T_WC: Array
    """Pose (4, 4) of the camera in the world; all rays start at its origin."""
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
    """Returns a camera that looks at `point` (3,) [m] from `distance` [m].

    It stands at `azimuth` [rad] around z, 0 in front (x) and +pi/2 on the left (y), and `elevation` [rad]
    above. Point, angles and "up" are in `frame` `T_WF` (4, 4); None stands for the world. Raises TciError for
    a distance, angle or size that gives no picture.
    """
    if not distance > 0.0:
        raise TciError(f"camera distance {distance} m; valid: more than 0")
    if not 0.0 < fov < np.pi:
        raise TciError(f"camera angle of view {fov} rad; valid: between 0 and pi")
    if not abs(elevation) < np.pi / 2:
        raise TciError(f"camera elevation {elevation} rad; valid: between -pi/2 and pi/2")
    if width < 1 or height < 1:
        raise TciError(f"picture of {width} x {height} pixels; valid: at least 1 x 1")
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
    """Returns the camera of `look_at` that shows all `points` (n, 3) [m] of the world as large as possible.

    It leaves `margin`, a fraction of the picture, free on each side. Raises TciError as `look_at` does.
    """
    camera = look_at(
        (0.0, 0.0, 0.0), azimuth=azimuth, elevation=elevation, distance=1.0,
        fov=fov, width=width, height=height, frame=frame,
    )  # fmt: skip
    R_WC = camera.T_WC[:3, :3]
    points_C = points @ R_WC
    sides, depth = points_C[:, :2], points_C[:, 2]
    slope = np.array([width, height]) * (0.5 - margin) / camera.focal
    # All points lie inside the four planes of the view: x - x0 <= slope (z - z0), and so on.
    far = depth[:, None] * slope
    back = -((sides - far).max(axis=0) + (-sides - far).max(axis=0)) / (2.0 * slope)
    z = min(float(back.min()), float(depth.min()) - _NEAREST)
    place = [_middle(sides[:, axis], depth - z) for axis in range(2)]
    return replace(camera, T_WC=read_only(transform(R_WC, R_WC @ np.array([*place, z]))))


def _middle(sides: Array, depth: Array) -> float:
    """Returns the sideways position [m] from which points at `sides` (n,) [m] and `depth` (n,) [m] are
    centred in the view."""
    low, high = float(sides.min()), float(sides.max())
    for _ in range(_HALVINGS):
        middle = (low + high) / 2.0
        seen = (sides - middle) / depth
        low, high = (middle, high) if seen.max() > -seen.min() else (low, middle)
    return (low + high) / 2.0


def pixel_centres(camera: Camera) -> Array:
    """Returns the centres (height * width, 2) of all pixels, row by row: x to the right, y down [pixels]."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def rays(camera: Camera, pixels: Array) -> Array:
    """Returns unit directions (n, 3) in the world of the rays through `pixels` (n, 2)."""
    centre = np.array([camera.width, camera.height]) / 2.0
    direction_C = np.ones((len(pixels), 3))
    direction_C[:, :2] = (pixels - centre) / camera.focal
    direction_C /= np.linalg.norm(direction_C, axis=1, keepdims=True)
    direction_W: Array = direction_C @ camera.T_WC[:3, :3].T
    return direction_W


def project(camera: Camera, points: Array) -> tuple[Array, Array]:
    """Projects points (n, 3) [m] of the world to pixels (n, 2), and returns their depths (n,) [m] too.

    Depth is measured along the camera's axis; the pixel of a point that is not in front of the camera (depth
    <= 0) is NaN.
    """
    points_C = apply(invert(camera.T_WC), points)
    depth = points_C[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = points_C[:, :2] * camera.focal / depth[:, None]
    pixels += np.array([camera.width, camera.height]) / 2.0
    pixels[depth <= 0.0] = np.nan
    return pixels, depth
