"""Proposes skin for a hand: a sleeve around the end of each finger, and a pad on the palm.

All values are assumed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.exports.cone import ConeFit
from tci.lab.authoring.find_fingers import Finger
from tci.lab.authoring.find_limbs import FoundLimbs
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.proposed_fingers import palm_of
from tci.lab.authoring.sleeves import cone_patch
from tci.messages.frames import Array
from tci.robot.description import GenericPart, Patch
from tci.robot.generic_fingers import PALM

# All values below are assumed: published fingers are 14 to 24 mm thick.
TIP, PAD = (0.3, 0.95), (0.45, 0.9)
"""TIP: section of a finger's last link that skin covers. PAD: section of the palm that the pad covers. Each
section is given by its begin and end, as fractions of the length."""
THIN, THICK, USUAL = 0.006, 0.014, 0.009
"""Least radius and largest radius [m] of a finger tip, and the radius of a finger tip for which the model has
no geometry."""
ROUND = 0.012
"""Radius [m] of the palm's skin (the pad), which is a cylinder whose axis is parallel to the palm."""
HEIGHT = 0.015
"""Height [m] of the palm's surface above the wrist's joint, if the model has no geometry for the palm."""
PITCH = 0.006
"""Distance [m] between neighbouring taxels."""


def hand_skin(
    body: FoundLimbs, found: Sequence[Finger], part: GenericPart, points: LinkPoints
) -> list[Patch]:
    """Returns the skin of one hand. `part` is the generic part that consists of the hand's fingers."""
    patches = []
    for finger in found:
        start = body.joints[finger.flexion[-1]].anchor
        shape = points.of([part.segment(finger.name).link]) @ body.R_RH
        off, along = _beside(shape, start, finger.tip)
        near = off[(along > TIP[0]) & (along < TIP[1])]
        radius = float(np.clip(np.quantile(near, 0.75), THIN, THICK)) if len(near) else USUAL
        fit = _cylinder(start, finger.tip, TIP, radius)
        name = f"{part.side}_{finger.name}_tip"
        patches.append(
            cone_patch(name, body, part, finger.name, fit, points, across=finger.axis, pitch=PITCH)
        )
    link, wrist = palm_of(body, found[0], points)
    others = [finger for finger in found if finger.name != "thumb"]
    bases = np.mean([body.joints[finger.flexion[0]].anchor for finger in others], axis=0)
    ahead = (bases - wrist) / np.linalg.norm(bases - wrist)
    palmar = np.sum([finger.palmar for finger in others], axis=0)
    palmar -= ahead * float(ahead @ palmar)
    palmar /= np.linalg.norm(palmar)
    shape = points.of([link]) @ body.R_RH
    along = (shape - wrist) @ ahead / float(np.linalg.norm(bases - wrist))
    near = shape[(along > PAD[0]) & (along < PAD[1])]
    height = float(np.max((near - wrist) @ palmar)) if len(near) else HEIGHT
    lift = palmar * (height - 0.5 * ROUND)
    fit = _cylinder(wrist + lift, bases + lift, PAD, ROUND)
    across = np.cross(ahead, palmar)
    patches.append(cone_patch(f"{part.side}_palm", body, part, PALM, fit, points, across=across, pitch=PITCH))
    return patches


def _beside(points: Array, start: Array, end: Array) -> tuple[Array, Array]:
    """Returns the distances (n,) [m] of points from an axis, and their places (n,) along the axis.

    A place is 0 at the start of the axis and 1 at its end.
    """
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    along = (points - start) @ axis
    off: Array = np.linalg.norm(points - start - along[:, None] * axis, axis=1)
    return off, along / length


def _cylinder(start: Array, end: Array, cover: tuple[float, float], radius: float) -> ConeFit:
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    return ConeFit(
        start + axis * length * cover[0], axis, length * (cover[1] - cover[0]), radius, radius, 0.0, 0.0
    )
