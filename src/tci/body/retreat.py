"""Displacement of contact points relative to the touching object, on the path that the gate would execute.

The gate is the safety filter before the driver. The prediction follows the rules of the gate: a motion starts
from rest, in the robot's own joints, within their limits and couplings, and each joint has its own
acceleration. Displacements are relative to the robot's root, since the torso may move too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from threading import local

import numpy as np
from numpy.typing import NDArray
from ruckig import InputParameter, Ruckig, RuckigError, Synchronization, Trajectory

from tci.body.kernels.retreat import Chain, Room, Touched, retreats
from tci.errors import CommandError, UnknownNameError
from tci.gate.bounds import Bounds, bounds_of
from tci.gate.kernels.couplings import shift
from tci.messages import Contacts, Mode, Site
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.joint_map import JointMap, joint_map
from tci.skin.layout import SkinLayout
from tci.skin.skin import Skin
from tci.support.compiled import entry

_retreats = entry(retreats)
EARLY = (0.01, 0.02)
"""The path of a motion is predicted first at these times [s] after its beginning. A path may begin in a
direction in which it does not end, because the joints accelerate differently. Assumed: these times are early
enough to notice this."""
SHARES = (0.25, 0.5, 0.75, 1.0)
"""After the times EARLY, the path of a motion is predicted at these fractions of its duration."""
AHEAD = 0.1
"""In velocity mode, the target of a prediction is the posture that the velocity reaches after this time [s].
Assumed: the next skin frame comes much sooner."""
TIMES = len(EARLY) + len(SHARES)
OBJECT = 0.008
"""Radius [m] of the sphere that represents a touching object. Assumed: the radius of a fingertip. The size of
an object is not known."""
UNKNOWN = 100.0
"""Value for a limit [rad/s, rad/s2, rad/s3] that is missing in the description. The size of this value does
not matter, since the gate refuses motions of a joint without limits."""


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """Joints, limits and motion planner of one generic part with k servos."""

    joints: JointMap
    inverse: Array | None
    """Derivatives (k, k) of a part's servo angles (columns) with respect to its generic angles (rows), if
    they are equal in all postures; else None."""
    bounds: Bounds
    outside: Array
    """Coefficients (m, n_servos) of the servos of other parts in the m couplings that limit this part; 0 for
    this part's own servos."""
    free: NDArray[np.bool_]
    """Mask (k,) of the servos whose targets may be changed if a coupling forbids the targets; here always
    True."""
    limits: list[tuple[float, float]]
    """Lower and upper limit [rad] of each of the k servos, from `bounds`."""
    velocity: list[float] | None
    """Largest velocity (k,) [rad/s] of each servo, if it is equal in all postures; else None."""
    planner: Ruckig
    input: InputParameter
    trajectory: Trajectory


class Retreat:
    """Predicts the displacement of contacts by motions of one robot.

    Threads may share this object, since each thread uses its own planners.
    """

    def __init__(self, skin: Skin, layout: SkinLayout) -> None:
        robot = self._robot = skin.robot
        links = tuple(dict.fromkeys(patch.link for patch in robot.patches))
        self._chain = skin.kinematics
        ends = self._chain.ends([self._chain.body(link) for link in links])
        after = dict(zip(links, ends.tolist(), strict=True))
        self._layout = layout.arrays
        self._links = Chain(
            self._chain.path(ends.tolist()),
            self._chain.steps,
            self._chain.sums,
            np.array([after[patch.description.link] for patch in layout.patches], np.int64),
        )
        ends_of = {patch.name: after[patch.link] for patch in robot.patches}

        @lru_cache(maxsize=16)
        def after_sites(sites: tuple[Site, ...]) -> NDArray[np.int64]:
            return np.array([ends_of[site.patch] for site in sites], np.int64)

        self._after = after_sites
        self._own = local()
        self._motions()  # built in advance, so that the first touch is not delayed

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
        """Returns displacements (3, k, c) [m] of c contacts while `part` moves to `target` (n,) [rad]. The k
        times are shortly after the start (EARLY), then at fractions of the motion's duration (SHARES).

        Row 0 of the result is the displacement of the contact point along the inward normal, negative towards
        the object. Row 1 is the length of its displacement perpendicular to the normal. Row 2 is the largest
        depth by which skin of any patch enters the object between the previous and this time; the depth at
        the start does not count. The object is assumed to be a sphere of the radius OBJECT that touches the
        contact point from outside, and that does not move. The motion starts at `position` (n_servos,) [rad].
        In position and impedance mode, all servos of the part arrive at the same time; in other modes, each
        servo moves as fast as it can. `driven` is True for a capability that commands a velocity in each
        period: `target` is then the posture that this velocity reaches after the time AHEAD, and the servos
        move no farther than they can in this time. Raises UnknownNameError for an unknown part.
        """
        motion = self._motion(part)
        angles = self._angles(motion, position, target, mode, driven)
        return self._displacements(angles, motion, contacts, OBJECT)

    def at_ends(self, position: Array, contacts: Contacts, part: str, targets: Array) -> Array:
        """Returns displacements (2, m, c) [m] of c contact points at the ends of m motions. Row 0 is the
        displacement along the inward normal, negative towards the object. Row 1 is the length of the
        displacement perpendicular to the normal.

        The motions go to `targets` (m, n) [rad]. The result equals the displacement that `along` returns for
        the end of a motion, but needs less computing time, because no motion is planned. Raises
        UnknownNameError for an unknown part.
        """
        motion = self._motion(part)
        angles = np.empty((len(targets) + 1, len(position)))
        angles[:] = position
        angles[1:, motion.joints.servos] = self._goals(motion, position, targets)
        return self._displacements(angles, motion, contacts, 0.0)

    def _displacements(self, angles: Array, motion: _Motion, contacts: Contacts, radius: float) -> Array:
        """Returns the displacements (3, k, c) [m] of c contact points in k postures. Row 0 is the component
        along the inward normal of each point, and row 1 the length of the component perpendicular to this
        normal. Row 2 is the largest depth by which skin enters the touching object on the way from the
        previous posture. If `radius` is 0, row 2 is missing.

        `angles` (k + 1, n_servos) [rad] contains the posture from which displacements are measured, and then
        the k postures. The touching objects are assumed to be spheres of `radius` [m].
        """
        count, steps, patches = len(contacts), len(self._chain.steps), len(self._links.ends)
        result = np.zeros((3 if radius else 2, len(angles) - 1, count))
        if motion.joints.servos.size and count:
            _retreats(
                self._chain.extended(angles),
                self._links,
                Touched(
                    self._after(contacts.sites)[contacts.site],
                    np.ascontiguousarray(contacts.p_L, np.float64),
                    np.ascontiguousarray(contacts.n_L, np.float64),
                ),
                self._layout,
                radius,
                Room(
                    np.empty((steps, 3, 4)),
                    np.empty((count, 3, 2)),
                    np.empty((count, patches, 5)),
                    np.empty((2, 3)),
                ),
                result,
            )
        return result

    def _motion(self, part: str) -> _Motion:
        motions = self._motions()
        if part not in motions:
            raise UnknownNameError("generic part", part, motions)
        return motions[part]

    def _goals(self, motion: _Motion, position: Array, targets: Array) -> Array:
        """Converts `targets` (m, n) [rad], generic angles of a part, to the angles (m, k) [rad] of the part's
        k servos, within limits and couplings."""
        joints, bounds = motion.joints, motion.bounds
        if motion.inverse is None or len(targets) == 1:
            goals: Array = np.array([joints.to_robot(target, position) for target in targets])
        else:  # the goals differ by a linear map of the differences between the targets
            apart = targets - targets[0]
            goals = joints.to_robot(targets[0], position) + apart.take(joints.ids, axis=1) @ motion.inverse
        return self._within(motion, position, np.minimum(np.maximum(goals, bounds.lower), bounds.upper))

    def _goal(self, motion: _Motion, position: Array, target: Array) -> list[float]:
        """Converts `target` (n,) [rad], generic angles of a part, to the angles (k,) [rad] of the part's k
        servos, within limits and couplings.

        This is faster than `_goals` for one target.
        """
        ends = motion.joints.to_robot(target, position).tolist()
        goal = [min(max(end, least), most) for end, (least, most) in zip(ends, motion.limits, strict=True)]
        if len(motion.outside):
            goal = self._within(motion, position, np.array([goal]))[0].tolist()
        return goal

    def _within(self, motion: _Motion, position: Array, goals: Array) -> Array:
        """Returns `goals` (m, k) [rad], m target angles for each of a part's k servos. A goal that a coupling
        forbids is replaced by a permitted goal close to it."""
        bounds = motion.bounds
        if len(motion.outside):
            lower, upper = np.empty_like(bounds.coupling_lower), np.empty_like(bounds.coupling_upper)
            shift(motion.outside, position, bounds.coupling_lower, bounds.coupling_upper, lower, upper)
            sums = goals @ bounds.coupling.T
            for row in np.flatnonzero(~((sums >= lower) & (sums <= upper)).all(axis=1)).tolist():
                own = replace(bounds, coupling_lower=lower, coupling_upper=upper)
                goals[row] = own.nearest(goals[row], motion.free)
        return goals

    def _driven_goal(self, motion: _Motion, position: Array, target: Array) -> Array | None:
        """Returns the angles (k,) [rad] that a part's k servos reach after 0.1 s (AHEAD), if a command in
        velocity mode drives the part from `position` (n_servos,) [rad] towards `target` (n,) [rad]. Returns
        None if the velocities of the servos can't be computed.

        Near a singular posture of a shoulder, these angles differ much from the angles for `target`.
        """
        joints, bounds = motion.joints, motion.bounds
        here = position[joints.servos]
        try:
            moved = joints.per_servo((target - joints.to_generic(position))[joints.ids], position)
        except (CommandError, np.linalg.LinAlgError):
            return None
        most = AHEAD * np.minimum(bounds.velocity, joints.driven_speeds(position))
        moved /= max(1.0, float(np.max(np.abs(moved) / most, initial=0.0)))
        ends: Array = np.clip(here + moved, bounds.lower, bounds.upper)
        return ends

    def _angles(self, motion: _Motion, position: Array, target: Array, mode: Mode, driven: bool) -> Array:
        """Predicts the motion of a part to `target` (n,) [rad]. Returns the angles (7, n_servos) [rad] of all
        servos: at the start, at two times shortly after it, and at four later times, the last at the end."""
        joints, servos, bounds = motion.joints, motion.joints.servos, motion.bounds
        here = position[servos]
        near = self._driven_goal(motion, position, target) if driven else None
        goal = self._goal(motion, position, target) if near is None else near.tolist()
        plan = motion.input
        plan.current_position, plan.target_position = here.tolist(), goal
        plan.max_velocity = motion.velocity or _velocity(joints, bounds, position)
        together = mode in (Mode.POSITION, Mode.IMPEDANCE)
        plan.synchronization = Synchronization.Time if together else Synchronization.No
        angles = np.empty((TIMES + 1, len(position)))
        angles[:] = position
        try:
            motion.planner.calculate(plan, motion.trajectory)
        except RuckigError:  # rare states have no synchronised trajectory
            angles[1:, servos] += np.linspace(0.0, 1.0, TIMES + 1)[1:, None] * (np.array(goal) - here)
            return angles
        at_time, duration = motion.trajectory.at_time, motion.trajectory.duration
        moments = [*EARLY, *(duration * share for share in SHARES)]
        angles[1:, servos] = [at_time(moment)[0] for moment in moments]
        return angles

    def _motions(self) -> dict[str, _Motion]:
        """Returns the joints, bounds and planner of each part, by part name. Each thread has its own
        planners."""
        own: dict[str, dict[str, _Motion]] = self._own.__dict__
        if "motions" not in own:
            own["motions"] = {part.name: _motion(self._robot, part.name) for part in self._robot.parts}
        return own["motions"]


def _motion(robot: Robot, part: str) -> _Motion:
    joints = joint_map(robot, part)
    count = len(joints.servos)
    bounds, outside = bounds_of(robot, joints.servos.tolist(), speed_share=1.0)
    unlimited = {"lower": -np.inf, "upper": np.inf, "velocity": UNKNOWN, "acceleration": UNKNOWN,
                 "jerk": UNKNOWN}  # fmt: skip
    known = {
        name: np.where(np.isnan(limit := getattr(bounds, name)), most, limit)
        for name, most in unlimited.items()
    }
    bounds = replace(bounds, **known)
    plan = InputParameter(count)
    plan.max_acceleration, plan.max_jerk = bounds.acceleration.tolist(), bounds.jerk.tolist()
    free = np.ones(count, np.bool_)
    constant = joints.exact and all(one.constant for one in joints.transforms)
    slope = joints.slope(np.zeros(len(robot.servos))) if constant else None
    inverse = None if slope is None else np.array(np.linalg.inv(slope).T, np.float64)
    limits = [*zip(bounds.lower.tolist(), bounds.upper.tolist(), strict=True)]
    steady = all(one.steady for one in joints.transforms)
    velocity = _velocity(joints, bounds, np.zeros(len(robot.servos))) if steady else None
    return _Motion(
        joints, inverse, bounds, outside, free, limits, velocity, Ruckig(count), plan, Trajectory(count)
    )


def _velocity(joints: JointMap, bounds: Bounds, position: Array) -> list[float]:
    """Returns the largest permitted velocity (k,) [rad/s] of each of the k servos in `joints`, while the
    robot's servos are at `position` (n_servos,) [rad]."""
    fastest: list[float] = np.minimum(bounds.velocity, joints.speeds(position)).tolist()
    return fastest
