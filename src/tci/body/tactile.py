"""Functions of tactile perception: the pressure image of a patch, the shape of a contact, shear, slip,
events.

The functions take perceptions or contacts, and the robot's `GenericBody`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from tci.body.generic_body import GenericBody
from tci.errors import TciError
from tci.messages import Contact, JointReading, Perception
from tci.messages.frames import Array, frozen
from tci.robot.generic_arm import side_sign
from tci.skin.layout import AXES
from tci.skin.triangulation import is_sheet, unroll

FRICTION = 0.5
"""Ratio of tangential to normal force at which an object slips on the skin. Assumed: between the values for
rubber on steel and rubber on wood. Measure the ratio of your skin: pull an object slowly until it slips."""
MOST_PIXELS = 2**24
"""Largest number of pixels of a pressure image: 4096 x 4096 pixels, which need 128 MiB. Assumed: nobody needs
a larger image."""


@dataclass(frozen=True, slots=True, eq=False)
class PressureImage:
    """Pressure on an unrolled patch, as seen from outside."""

    pressure: Array
    """Pressure (rows, columns) [Pa], NaN where the patch has no skin; the first row is at the top."""
    pixel: float
    """Width and height [m] of the area on the skin that one pixel shows."""
    corner: tuple[float, float]
    """Coordinates [m] of the image's lower left corner, to the right and up, in the plane in which `places`
    gives the taxels."""
    places: Array
    """Coordinates (taxels, 2) [m] of the taxels in the plane of the image: to the right, and up.

    On a limb, the first coordinate is the arc length around the limb from its flexor side; the second is the
    distance from the distal end of the segment. On a left limb, the lateral side is to the right of the
    flexor side; on a right limb, the lateral side is to the left of the flexor side.
    """


def pressure_image(
    perception: Perception, body: GenericBody, patch: str, *, pixel: float = 0.002
) -> PressureImage:
    """Returns the pressure on a patch as an image. Each pixel has the pressure of the nearest taxel.

    A sleeve on a limb is cut along its extensor side and unrolled at its mean radius. A sleeve on another
    part is unrolled too, but the place of its cut is arbitrary. A flat patch is projected onto its mean
    plane. All images show the skin from outside, so the image of a left limb is the mirror image of a right
    limb's image.

    Raises UnknownNameError for an unknown patch. Raises TciError for a perception without skin, for a pixel
    size that is not above 0, and for a pixel size that results in more than MOST_PIXELS pixels.
    """
    if perception.skin is None or perception.joints is None:
        raise TciError("a perception without skin has no pressure image; valid: one made by a Perceiver")
    if not 0.0 < pixel < np.inf:
        raise TciError(f"pressure image: pixel {pixel} m; valid: above 0 and finite")
    places, turn = unrolled(body, patch, perception.joints)
    surface = body.skin.surfaces[patch]
    reach = np.sqrt(surface.areas)[:, None]
    ends = np.array([turn / 2.0, np.inf])
    corner = np.maximum((places - reach).min(axis=0), -ends)
    size = np.minimum((places + reach).max(axis=0), ends) - corner
    if size.prod() > MOST_PIXELS * pixel**2:
        least = float(np.sqrt(size.prod() / MOST_PIXELS))
        raise TciError(f"pressure image: pixel {pixel} m; valid: {least:.2g} m or more on {patch}")
    columns, rows = np.ceil(size / pixel).astype(int)
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows)[::-1] + 0.5)
    # a sleeve of skin is continuous across the cut
    turns = (0.0, -turn, turn) if np.isfinite(turn) else (0.0,)
    tree = cKDTree(np.concatenate([np.add(places, (shift, 0.0)) for shift in turns]))
    apart, nearest = tree.query(np.stack([x, y], axis=-1) * pixel + corner)
    nearest %= len(places)
    image = perception.skin.on(body.layout.places[patch])[nearest]
    image[apart > reach[nearest, 0]] = np.nan
    return PressureImage(frozen(image), pixel, (float(corner[0]), float(corner[1])), frozen(places))


def unrolled(body: GenericBody, patch: str, joints: JointReading) -> tuple[Array, float]:
    """Returns the coordinates (taxels, 2) [m] of a patch's taxels in the plane of its pressure image.

    Also returns the length [m] of one full turn around the limb, which is infinite for a flat patch. Raises
    UnknownNameError for an unknown patch.
    """
    description = body.robot.patch(patch)
    surface = body.skin.surfaces[patch]
    segment = body.robot.limb_segment(description)
    if is_sheet(surface.normals):
        return _flattened(surface.positions, surface.normals), np.inf
    if segment is None:
        places, turn, axes = unroll(surface.positions, surface.normals)
        # the first coordinate is to the right as seen from outside
        places[:, 0] *= np.sign(np.linalg.det(axes))
        return places, turn
    u, theta, radius = body.skin.limb(patch, joints)
    side, mean = side_sign(body.robot.part(description.part).side or "left"), float(radius.mean())
    return np.column_stack([side * theta * mean, (1.0 - u) * segment.length]), 2.0 * np.pi * mean


@dataclass(frozen=True, slots=True, eq=False)
class ContactShape:
    """Ellipse that approximates a contact. Ellipse and contact have equal second moments of pressure."""

    area: float
    """Area [m2] of the ellipse. A uniform pressure on the ellipse would have the same second moments as the
    pressure of the contact."""
    axes: Array
    """Half of the length and half of the width (2,) [m] of the ellipse."""
    directions: Array
    """Unit vectors (2, 3) along the length and the width of the ellipse, in the frame of the patch's link."""


def contact_shape(contact: Contact, body: GenericBody) -> ContactShape:
    """Returns the shape of a contact in the tangential plane of the skin, at the centre of the contact.

    Each taxel counts as a square with the taxel's area. So the shape of a contact with a single taxel has the
    size of this taxel, and not the size 0. Raises UnknownNameError for a contact of another robot.
    """
    surface = body.skin.surfaces[body.robot.patch(contact.patch).name]
    points, force = surface.positions[contact.taxels], contact.taxel_forces
    apart = points - force @ points / force.sum()
    across = np.eye(3) - np.outer(contact.n_L, contact.n_L)
    own = float(force @ surface.areas[contact.taxels] / force.sum()) / 12.0
    moments = across @ ((apart.T * force) @ apart / force.sum() + own * np.eye(3)) @ across
    values, vectors = np.linalg.eigh(moments)  # the smallest of the three values is 0, along the normal
    axes = 2.0 * np.sqrt(
        values[:0:-1]
    )  # along each axis, a uniform ellipse has a variance of a quarter of the squared half axis
    return ContactShape(float(np.pi * axes.prod()), frozen(axes), frozen(vectors.T[:0:-1].copy()))


@dataclass(frozen=True, slots=True, eq=False)
class ShearForce:
    """Tangential force of a contact."""

    tangential: Array
    """Tangential force (3,) [N] on the skin, in the torso frame."""
    normal: float
    """Normal force [N] on the skin."""

    @property
    def ratio(self) -> float:
        """Returns the ratio of tangential to normal force; infinite without normal force."""
        size = float(np.linalg.norm(self.tangential))
        return size / self.normal if self.normal > 0.0 else np.inf if size > 0.0 else 0.0


def shear_force(contact: Contact, body: GenericBody) -> ShearForce | None:
    """Returns the shear force of a contact; None if the taxels of its skin measure only pressure.

    Raises UnknownNameError for a contact of another robot.
    """
    if body.robot.patch(contact.patch).sensor.axes != AXES:
        return None
    normal = -float(contact.f_T @ contact.n_T)
    return ShearForce(frozen(contact.f_T + normal * contact.n_T), normal)


@dataclass(frozen=True, slots=True)
class TouchEvent:
    """Beginning, slip, end or return of a contact.

    If a contact vanishes for a moment and keeps its identity (see `TrackSettings.linger`), there are two
    events: the end of the contact, and later its return.
    """

    kind: Literal["onset", "slip", "end", "return"]
    contact: int
    """Identity of the contact."""
    patch: str
    stamp: float
    """Time [s] of the skin frame in which the event was detected, on the driver's clock."""


def touch_events(
    before: Perception | None, now: Perception, body: GenericBody, *, friction: float = FRICTION
) -> tuple[TouchEvent, ...]:
    """Returns the events of contacts between two perceptions, in order of time.

    A contact on three-axis skin begins to slip when its shear force reaches `friction` times its normal
    force. On skin that measures only pressure, slip is not detected. Raises TciError if `friction` is not
    above 0 and finite.
    """
    if not 0.0 < friction < np.inf:
        raise TciError(f"touch events: friction {friction}; valid: above 0 and finite")
    known = {} if before is None else {one.identity: one for one in before.contacts}
    found = []
    for one in now.contacts:
        then = known.get(one.identity)
        if then is None and before is not None and one.onset <= _stamp(before, one.patch, body):
            found.append(TouchEvent("return", one.identity, one.patch, one.stamp))
        elif then is None:
            found.append(TouchEvent("onset", one.identity, one.patch, one.onset))
        if _slips(one, body, friction) and not (then is not None and _slips(then, body, friction)):
            found.append(TouchEvent("slip", one.identity, one.patch, one.stamp))
    going = {one.identity for one in now.contacts}
    for identity, then in known.items():
        if identity not in going:
            found.append(TouchEvent("end", identity, then.patch, _stamp(now, then.patch, body)))
    return tuple(sorted(found, key=lambda event: (event.stamp, event.contact)))


def _stamp(perception: Perception, patch: str, body: GenericBody) -> float:
    """Returns the time [s] of a patch's frame; NaN if the patch has sent no frame."""
    if perception.skin is None:
        return perception.stamp
    return float(perception.skin.stamp[body.layout.places[patch]])


def _slips(contact: Contact, body: GenericBody, friction: float) -> bool:
    shear = shear_force(contact, body)
    return shear is not None and shear.ratio >= friction


def _flattened(positions: Array, normals: Array) -> Array:
    """Returns the coordinates (n, 2) [m] of points (n, 3) in their mean plane, as seen from outside.

    The first coordinate is along the direction in which the points are spread most widely.
    """
    centred = positions - positions.mean(axis=0)
    normal = normals.mean(axis=0)
    plane = centred - np.outer(centred @ normal, normal) / max(float(normal @ normal), 1e-12)
    first = np.linalg.svd(plane, full_matrices=False)[2][0]
    second = np.cross(normal, first) / max(float(np.linalg.norm(normal)), 1e-12)
    places: Array = plane @ np.column_stack([first, second])
    return places
