"""Displacement of contact points relative to the touching object, on the path that the gate would execute.

The gate is the safety filter before the driver. The prediction follows the rules of the gate: a motion starts
from rest, in the robot's own joints, within their limits and couplings, and each joint has its own
acceleration. Displacements are relative to the robot's root, since the torso may move too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.body.kernels.goals import Within, keep_within
from tci.body.kernels.rest_to_rest import TIMES, Speeds, predict, quickest
from tci.body.kernels.retreat import NEAR, Chain, Room, retreats
from tci.errors import CommandError, UnknownNameError
from tci.gate.bounds import bounds_of
from tci.messages import Contacts, Mode
from tci.messages.frames import Array, frozen, read_only
from tci.robot.description import Robot
from tci.robot.joint_map import JointMap, joint_map
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin

AHEAD = 0.1
"""In velocity mode, the target of a prediction is the posture that the velocity reaches after this time [s].
Assumed: the next skin frame comes much sooner."""
OBJECT = 0.008
"""Radius [m] of the sphere that represents a touching object. Assumed: the radius of a fingertip. The size of
an object is not known."""
UNKNOWN = 100.0
"""Value for a limit [rad/s, rad/s2, rad/s3] that is missing in the description. The size of this value does
not matter, since the gate refuses motions of a joint without limits."""


class Retreat:
    """Predicts the displacement of contacts by motions of one robot. The object is immutable."""

    def __init__(self, skin: Skin, layout: SkinLayout) -> None:
        robot, self._chain = skin.robot, skin.kinematics
        self._parts: Mapping[str, _Part] = {part.name: _part(robot, part.name) for part in robot.parts}
        links = tuple(dict.fromkeys(patch.link for patch in robot.patches))
        ends = self._chain.ends([self._chain.body(link) for link in links])
        after = dict(zip(links, ends.tolist(), strict=True))
        self._after = {patch.name: after[patch.link] for patch in robot.patches}
        self._layout = layout.arrays
        self._links = Chain(
            self._chain.path(ends.tolist()),
            self._chain.steps,
            self._chain.sums,
            read_only([after[patch.description.link] for patch in layout.patches], np.int64),
        )

    def along(
        self,
        position: Array,
        contacts: Contacts,
        part: str,
        target: Array,
        mode: Mode,
        *,
        driven: bool = False,
    ) -> Array:
        """Displacements (3, k, c) [m] of c contacts while `part` moves to `target` (n,) [rad].

        The k times are shortly after the start (EARLY), then at fractions of the motion's duration (SHARES).
        Row 0 is the displacement of the contact point along the inward normal, negative towards the object.
        Row 1 is the length of its displacement perpendicular to the normal. Row 2 is the largest depth by
        which skin of any patch enters the object between the previous and this time; the depth at the start
        does not count. The object is assumed to be a sphere of the radius OBJECT that touches the contact
        point from outside, and that does not move.

        In position and impedance mode, all servos of the part arrive at the same time; in other modes, each
        moves as fast as it can.

        Args:
            position: Angles (n_servos,) [rad] of all servos at the start.
            contacts: The c contacts.
            part: Name of the generic part. Raises UnknownNameError for an unknown part.
            target: Generic angles at the end.
            mode: Control mode of the motion.
            driven: True for a capability that commands a velocity in each period: `target` is then the
                posture that this velocity reaches after AHEAD, and the servos move no farther than they can
                in this time.
        """
        moved = self._part(part)
        goal = moved.driven_goal(target, position) if driven else None
        if goal is None:
            goal = moved.goals(target[None], position)[0]
        way = np.empty((TIMES + 1, len(position)))
        way[:] = position
        together = mode in (Mode.POSITION, Mode.IMPEDANCE)
        predict(way, moved.joints.servos, goal, moved.speeds(position), together)
        return self._displacements(way, moved, contacts, OBJECT)

    def at_ends(self, position: Array, contacts: Contacts, part: str, targets: Array) -> Array:
        """Displacements (2, m, c) [m] of c contact points at the ends of m motions to `targets` (m, n) [rad]:
        the first two rows that `along` returns for the end of each motion, in much less time."""
        moved = self._part(part)
        way = np.empty((len(targets) + 1, len(position)))
        way[:] = position
        way[1:, moved.joints.servos] = moved.goals(targets, position)
        return self._displacements(way, moved, contacts, 0.0)

    def fastest(self, position: Array, part: str, target: Array) -> tuple[NDArray[np.intp], Array, float]:
        """How `part` moves to generic angles `target` (n,) [rad], if all its servos arrive together: the
        servos (k,), their ways (k,) [rad], and the greatest speed, in ways per second."""
        moved = self._part(part)
        servos = moved.joints.servos
        way = moved.goals(target[None], position)[0] - position[servos]
        return servos, way, quickest(way, moved.speeds(position))

    def _displacements(self, way: Array, moved: _Part, contacts: Contacts, radius: float) -> Array:
        """Displacements (3, k, c) [m] of the contact points in the k postures after the first of `way` (k +
        1, n_servos) [rad]; without row 2 if `radius` is 0."""
        count, steps, patches = len(contacts), len(self._chain.steps), len(self._links.ends)
        result = np.zeros((3 if radius else 2, len(way) - 1, count))
        if moved.joints.servos.size and count:
            after = [self._after[contacts.sites[site].patch] for site in contacts.site.tolist()]
            retreats(
                self._chain.extended(way),
                self._links,
                read_only(after, np.int64),
                contacts.rows,
                self._layout,
                radius,
                Room(
                    np.empty((steps, 3, 4)),
                    np.empty((count, 3, 2)),
                    np.empty((count, patches), NEAR),
                    np.empty((2, 3)),
                ),
                result,
            )
        return result

    def _part(self, name: str) -> _Part:
        if name not in self._parts:
            raise UnknownNameError("generic part", name, self._parts)
        return self._parts[name]


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """What the motion of one generic part with k servos depends on."""

    joints: JointMap
    within: Within
    most: Speeds
    steady: bool
    """True if the speeds that the joints permit are the same in all postures, and included in `most`."""

    def goals(self, targets: Array, position: Array) -> Array:
        """Servo angles (g, k) [rad] for generic angles `targets` (g, n), within limits and couplings."""
        goals = self.joints.goal(targets, position)
        keep_within(position, self.within, goals, np.empty((2, len(self.within.outside))))
        return goals

    def driven_goal(self, target: Array, position: Array) -> Array | None:
        """Servo angles (k,) [rad] after AHEAD, if a velocity drives the part towards `target` (n,) [rad];
        None if the servos' velocities can't be computed.

        Near a singular posture of a shoulder, these angles differ much from the angles for `target`.
        """
        joints, within = self.joints, self.within
        try:
            moved = joints.per_servo((target - joints.to_generic(position))[joints.ids], position)
        except (CommandError, np.linalg.LinAlgError):
            return None
        most = AHEAD * np.minimum(self.most.velocity, joints.driven_speeds(position))
        moved /= max(1.0, float(np.max(np.abs(moved) / most, initial=0.0)))
        ends: Array = np.clip(position[joints.servos] + moved, within.lower, within.upper)
        return ends

    def speeds(self, position: Array) -> Speeds:
        """Limits of the servos while they are at `position` (n_servos,) [rad]."""
        if self.steady:
            return self.most
        return self.most._replace(
            velocity=frozen(np.minimum(self.most.velocity, self.joints.speeds(position)))
        )


def _part(robot: Robot, name: str) -> _Part:
    joints = joint_map(robot, name)
    bounds, outside = bounds_of(robot, joints.servos.tolist(), speed_share=1.0)
    within = Within(
        _known(bounds.lower, -np.inf),
        _known(bounds.upper, np.inf),
        read_only(np.ascontiguousarray(bounds.coupling)),
        read_only(bounds.coupling_lower),
        read_only(bounds.coupling_upper),
        read_only(np.ascontiguousarray(outside)),
        read_only(np.ones(len(joints.servos)), np.bool_),
    )
    limits = bounds.velocity, bounds.acceleration, bounds.jerk
    most = Speeds(*[_known(limit, UNKNOWN) for limit in limits])
    steady = all(transform.steady for transform in joints.transforms)
    if steady:
        fastest = np.minimum(most.velocity, joints.speeds(np.zeros(len(robot.servos))))
        most = most._replace(velocity=frozen(fastest))
    return _Part(joints, within, most, steady)


def _known(limits: Array, unknown: float) -> Array:
    return frozen(np.where(np.isnan(limits), unknown, limits))
