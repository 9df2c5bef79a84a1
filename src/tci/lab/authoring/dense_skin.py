"""Creates variants of a robot's skin, to test how TCI scales: more taxels or patches, another frame rate."""

from __future__ import annotations

import numpy as np

from tci.errors import CommandError, TciError
from tci.exports.cone import ConeFit, cone_of
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot, TruncatedCone
from tci.robot.kinematics import KinematicChain
from tci.skin.surfaces import build_surface

PITCH = 0.004
"""Default least distance [m] between taxels. Assumed: about the distance on an iCub's fingertips."""


def with_dense_skin(robot: Robot, taxels: int, *, patches: int | None = None, pitch: float = PITCH) -> Robot:
    """Returns the robot with about `taxels` taxels in `patches` patches, which lie on cones around its limbs.

    The cones are fitted to the present skin of the limbs. If there are more new patches than present ones,
    each cone is divided along its axis into sections, one per patch. If the taxels would lie closer together
    than `pitch` [m], the cones are made wider than the limbs. Raises TciError for a robot without skin on
    limbs, or for fewer than 9 taxels in a patch.
    """
    own = [patch for patch in robot.patches if robot.limb_segment(patch)]
    count = len(own) if patches is None else patches
    if not own or count < 1 or taxels < 9 * count:
        raise TciError(
            f"{taxels} taxels in {count} patches on {robot.name}, which has {len(own)} on limbs; "
            "valid: a robot with skin, and 9 taxels or more in each patch"
        )
    kinematics = KinematicChain(robot)
    fits = [cone_of(robot, build_surface(robot, patch, kinematics), kinematics) for patch in own]
    shares = [len(range(place, count, len(own))) for place in range(len(own))]
    made = [
        _piece(own[place], fits[place], index // len(own), shares[place], taxels // count, pitch)
        for index in range(count)
        for place in [index % len(own)]
    ]
    return robot.model_copy(update={"patches": tuple(made)})


def _piece(patch: Patch, fit: ConeFit, number: int, of: int, taxels: int, pitch: float) -> Patch:
    """Returns a patch with about `taxels` taxels on section `number` (from 0) of the `of` sections of a
    limb's cone `fit`. The patch is wider than the limb if its taxels would otherwise be closer together than
    `pitch` [m]."""
    gap = 0.05 if number + 1 < of else 0.0
    begin, end = fit.length * number / of, fit.length * (number + 1 - gap) / of
    r1, r2 = float(fit.radius(np.array(begin))), float(fit.radius(np.array(end)))
    around, along = np.pi * (r1 + r2), end - begin
    rings = max(2, round(float(np.sqrt(taxels * along / around))))
    per_ring = max(3, round(taxels / rings))
    scale = max(1.0, pitch * per_ring / around, pitch * rings / along)
    cone = TruncatedCone(
        origin=tuple((fit.origin + begin * fit.axis).tolist()),
        rpy=_towards(fit.axis),
        length=scale * along,
        r1=scale * r1,
        r2=scale * r2,
        rings=rings,
        per_ring=per_ring,
    )
    name = patch.name if of == 1 else f"{patch.name}_{number + 1}"
    return patch.model_copy(update={"name": name, "channels": rings * per_ring, "surface": cone})


def _towards(axis: Array) -> tuple[float, float, float]:
    """Returns roll, pitch and yaw [rad] of a frame with its negative z axis along `axis` (3,)."""
    x, y, z = -axis
    return 0.0, float(np.arctan2(np.hypot(x, y), z)), float(np.arctan2(y, x))


def with_skin_rate(robot: Robot, rate: float) -> Robot:
    """Returns the robot with skin frames at `rate` [Hz]. Raises CommandError for a rate out of range."""
    if not 1.0 <= rate <= 1000.0:
        raise CommandError(f"skin rate {rate:g} Hz; valid: 1 to 1000")
    patches = tuple(patch.model_copy(update={"rate": rate}) for patch in robot.patches)
    return robot.model_copy(update={"patches": patches})
