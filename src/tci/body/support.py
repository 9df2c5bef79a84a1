"""Static stability of a standing robot: the centre of mass over the soles that bear weight.

The ground is assumed to be horizontal, so that the normal of a loaded sole is vertical. A posture is
statically stable while the centre of mass lies over the polygon around the loaded soles (Vukobratovic and
Borovac 2004).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.errors import DescriptionError
from tci.gate.contact.balance import LOADED
from tci.messages import Contact, Support
from tci.messages.frames import Array, apply
from tci.robot.description import SOLE
from tci.robot.gravity import Gravity
from tci.robot.joint_map import joint_map
from tci.skin.skin import Skin


class StaticStability:
    """Predicts the static stability of one robot after a motion of a leg."""

    def __init__(self, skin: Skin) -> None:
        self._skin = skin
        self._soles = [patch for patch in skin.robot.patches if patch.segment == SOLE]
        if self._soles:
            # The import takes 0.2 s. No period of a loop may wait for this, and robots without soles need no
            # import.
            import scipy.spatial  # noqa: F401
        try:
            self._gravity: Gravity | None = Gravity(skin.robot) if self._soles else None
        except DescriptionError:  # the masses are missing in the model
            self._gravity = None

    def support(self, contacts: Iterable[Contact], position: Array, part: str, target: Array) -> Support:
        """Returns the support of the robot after a motion of the leg `part` to generic angles `target` (n,)
        [rad].

        The forces on the soles are those of `contacts`. Before the motion, the servos are at `position`
        (n_servos,) [rad]. Raises UnknownNameError for an unknown part.
        """
        forces = dict.fromkeys([patch.part for patch in self._soles], 0.0)
        for contact in contacts:
            if contact.segment == SOLE:
                forces[contact.part] += contact.force
        others = [p for p in self._soles if p.part != part and forces[p.part] >= LOADED]
        if self._gravity is None or not others:
            return Support(forces, -np.inf)
        joints = joint_map(self._skin.robot, part)
        there = np.array(position)
        there[joints.servos] = joints.to_robot(target, position)
        poses = self._skin.kinematics.poses(position, [patch.link for patch in others])
        surfaces = [self._skin.surfaces[patch.name] for patch in others]
        points = np.concatenate([apply(poses[s.link], s.positions) for s in surfaces])
        down = np.concatenate([s.normals @ poses[s.link][:3, :3].T for s in surfaces]).mean(axis=0)
        return Support(forces, inside(self._gravity.centre_of_mass(there), points, down))


def inside(point: Array, corners: Array, along: Array) -> float:
    """Returns the distance [m] of `point` (3,) from the edge of the convex hull of `corners` (n, 3).

    The point and the corners are first projected along the direction `along` (3,). The distance is positive
    inside the hull, negative outside, and -inf if the corners span no area.
    """
    from scipy.spatial import ConvexHull, QhullError

    across = np.linalg.svd(along[None])[2][1:]
    try:
        hull = ConvexHull(corners @ across.T)
    except QhullError:
        return -np.inf
    return -float((hull.equations[:, :2] @ (across @ point) + hull.equations[:, 2]).max())
