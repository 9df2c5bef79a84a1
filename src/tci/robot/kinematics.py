"""Forward kinematics and Jacobians of a robot's links.

The path to a link is a sequence of steps, which a compiled loop follows. On a revolute joint at angle q, a
step is the pose K0 + K1 cos q + K2 sin q, with constant matrices K0, K1 and K2 (3, 4). These follow from
Rodrigues' formula R = a a^T + (1 - a a^T) cos q + [a] sin q, with the joint's axis a, and the matrix [a] of
the cross product with a. On a prismatic joint, the step is the pose K0 + K1 q.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tci.errors import CommandError, DescriptionError, Fault, UnknownNameError
from tci.messages.frames import Array, read_only, transform
from tci.robot.description import Model, Robot
from tci.robot.kernels.links import STEP, VISIT, link_poses, pose_and_jacobian
from tci.robot.like import RobotLike, as_robot
from tci.robot.model_file import BOUND_INERTIA, BOUND_MASS, compiled, load_spec
from tci.robot.per_robot import per_robot
from tci.support.engine import mujoco

_ORIGIN = np.zeros(3)
_SLIDE = int(mujoco.mjtJoint.mjJNT_SLIDE)
_ONE_AXIS = int(mujoco.mjtJoint.mjJNT_HINGE), _SLIDE
Indices = NDArray[np.int64]
Records = NDArray[np.void]


class KinematicChain:
    """Kinematics of one robot. The object is immutable, so several threads may use it. Callers may change
    returned arrays.

    Joints of the model that no servo moves stay at zero. A joint that follows a servo (a mimic joint) is
    treated like an additional servo, whose angle is appended to the angles of the servos.
    """

    def __init__(self, robot: RobotLike) -> None:
        """Reads the robot's model. All chains of one robot share what they compute.

        Raises DescriptionError if the robot has no model, or if a joint or the torso is missing in the model.
        """
        robot = as_robot(robot)
        if robot.model is None:
            raise DescriptionError(
                robot.source, [Fault(0, "no <model>: kinematics need a URDF or MJCF file")]
            )
        tables = _tables(robot, written(robot.model))
        self._bodies = tables.bodies
        self.links: tuple[str, ...] = tuple(self._bodies)
        """Names of all links, in the model's order."""
        self.n_servos = len(robot.servos)
        """Number of servos of the robot: the length of each argument `position`."""
        self._mimics = tables.mimics
        self.torso = tables.torso
        """Index in `steps` of the kinematic step that ends at the torso frame."""
        self.steps: Records = tables.steps
        """Steps (s,), each a `STEP`."""
        self.sums: Array = tables.sums
        """Matrices K0, K1 and K2 (s, 3, 3, 4) of the s steps. Relative to the end of the previous step, the
        pose at the end of a step is K0 + K1 cos q + K2 sin q at the joint angle q, and K0 + K1 q for a
        prismatic joint. The last column of the pose is the position [m]."""
        self._axes, self._after = tables.axes, tables.after
        self._asked, self._jacobians, self._chains = tables.asked, tables.jacobians, tables.chains

    def poses(self, position: ArrayLike, links: Iterable[str]) -> dict[str, Array]:
        """Returns `T_TL` (4, 4), the pose in the torso frame, of each of `links`.

        `position` (n_servos,) [rad] is in the order of `Robot.servos`. Servos without a joint in the model
        have no effect. Raises CommandError if `position` has another shape, and UnknownNameError if a link is
        missing in the model.
        """
        names = tuple(links)
        return dict(zip(names, self.pose_array(position, names), strict=True))

    def pose_array(self, position: ArrayLike, links: tuple[str, ...]) -> Array:
        """Returns `T_TL` (l, 4, 4), the poses in the torso frame, of l `links`, at the servo angles
        `position` (n_servos,) [rad]. Raises the errors of `poses`."""
        found = self._asked.get(links)
        if found is None:
            ends = self.ends([self.body(link) for link in links])
            found = self._asked[links] = ends, self.path(ends.tolist())
        return self._poses(position, *found)

    def body_poses(self, position: ArrayLike, bodies: Iterable[int]) -> Array:
        """Returns `T_TL` (l, 4, 4), the poses in the torso frame, of links given by their indices in the
        model. `position` (n_servos,) [rad] is in the order of `Robot.servos`."""
        ends = self.ends(bodies)
        return self._poses(position, ends, self.path(ends.tolist()))

    def jacobian(self, position: ArrayLike, link: str, *, point: ArrayLike = _ORIGIN) -> Array:
        """Returns the Jacobian (6, n_servos) of a point of `link`, in the torso frame.

        Rows 0-2 are the velocity of the point [m/rad], and rows 3-5 are the angular velocity of the link
        [rad/rad]; both are relative to the torso. `point` (3,) [m] is given in the frame of `link`. Raises
        CommandError if `position` or `point` has another shape, and UnknownNameError if the model lacks the
        link.
        """
        return self.pose_and_jacobian(position, link, point=point)[1]

    def pose_and_jacobian(
        self, position: ArrayLike, link: str, *, point: ArrayLike = _ORIGIN
    ) -> tuple[Array, Array]:
        """Returns the pose `T_TP` (4, 4) and the Jacobian (6, n_servos) of `point` (3,) [m], given in the
        frame of `link`. Rows 0-2 of the Jacobian are the linear velocity, rows 3-5 the angular velocity. The
        pose has the orientation of the link and the position of `point`. One call is faster than calls of
        `pose_array` and `jacobian`."""
        if np.shape(point) != (3,):
            raise CommandError(f"point of shape {np.shape(point)}; valid: (3,)")
        found = self._jacobians.get(link)
        if found is None:
            ends = np.array([self._after[self.body(link)], self.torso], np.int64)
            found = self._jacobians[link] = ends, self.path(ends.tolist())
        ends, path = found
        T_TP, jacobian = np.empty((4, 4)), np.zeros((6, self.n_servos + self._mimics.count))
        pose_and_jacobian(
            self._checked(position), path, self.steps, self.sums, self._axes, ends,
            np.asarray(point, np.float64), np.empty((len(self.steps), 3, 4)), T_TP, jacobian,
        )  # fmt: skip
        return T_TP, self._mimics.folded(jacobian)

    def chain(self, link: str) -> tuple[int, ...]:
        """Returns the servos that move `link` relative to the torso, in order from the torso.

        Raises UnknownNameError if the model lacks the link.
        """
        found = self._chains.get(link)
        if found is None:
            up, down = self._above(self.torso), self._above(int(self._after[self.body(link)]))
            way = [step for step in up if step not in down] + [step for step in down[::-1] if step not in up]
            led = [self._mimics.leader(servo) for servo in self.steps["servo"][way].tolist()] if way else []
            found = self._chains[link] = tuple(dict.fromkeys(servo for servo in led if servo >= 0))
        return found

    def extended(self, position: ArrayLike) -> Array:
        """Returns angles (..., n_servos) [rad] with the angles of mimic joints appended, because the steps
        need these angles."""
        return self._mimics.extended(np.asarray(position, np.float64))

    def ends(self, bodies: Iterable[int]) -> Indices:
        """Returns the step that leads to each of l `bodies`, which are indices in the model. The result (l,)
        contains row numbers of the table `steps`."""
        return np.array([self._after[body] for body in bodies], np.int64)

    def path(self, ends: Iterable[int]) -> Records:
        """Returns a `VISIT` (k,) of each of k steps: all steps on the paths from the model's root to the
        torso and to some links. `ends` are the indices in `steps` of the last step to each link. Parents come
        first.

        The sign is 1 if the step's servo moves the first
        of these links but not the torso, -1 if the servo moves the torso but not this link, and 0 otherwise.
        """
        above = [self._above(end) for end in ends]
        torso = self._above(self.torso)
        first = above[0] if above else []
        steps = sorted({step for way in (torso, *above) for step in way})
        signs = [
            (int(step in first) - int(step in torso)) * int(self.steps["servo"][step] >= 0) for step in steps
        ]
        return read_only([*zip(steps, signs, strict=True)], VISIT)

    def body(self, link: str) -> int:
        """Returns the index of a link in the model. Raises UnknownNameError if the model lacks the link."""
        try:
            return self._bodies[link]
        except KeyError:
            raise UnknownNameError("link of the kinematic model", link, self.links) from None

    def _poses(self, position: ArrayLike, ends: Indices, path: Records) -> Array:
        poses, work = np.empty((len(ends), 4, 4)), np.empty((len(self.steps), 3, 4))
        link_poses(self._checked(position), path, self.steps, self.sums, ends, self.torso, work, poses)
        return poses

    def _above(self, step: int) -> list[int]:
        """Returns the indices of `step` and of all steps before it, up to the root of the model. A step is a
        fixed offset or a joint."""
        result = []
        while step >= 0:
            result.append(step)
            step = int(self.steps["before"][step])
        return result

    def _checked(self, position: ArrayLike) -> Array:
        angles = np.ascontiguousarray(position, np.float64)
        if angles.shape != (self.n_servos,):
            raise CommandError(f"position of shape {angles.shape}; the robot has {self.n_servos} servos")
        return self._mimics.extended(angles)


class _Mimics:
    """Mimic joints of a robot: joints that follow a servo. Their indices follow those of the servos."""

    def __init__(self, robot: Robot) -> None:
        found = [(servo, one) for servo in robot.servos for one in servo.mimics]
        self.count = len(found)
        self._first = len(robot.servos)
        self._servos = np.array([servo.index for servo, _ in found], dtype=np.intp)
        self._multiplier = np.array([one.multiplier for _, one in found])
        self._offset = np.array([one.offset for _, one in found])

    def leader(self, servo: int) -> int:
        """Returns the index of the servo that a mimic joint follows. `servo` is the index of the mimic joint,
        counted after the servos; the index of a servo is returned unchanged."""
        return servo if servo < self._first else int(self._servos[servo - self._first])

    def extended(self, position: Array) -> Array:
        """Returns `position` (..., n_servos) [rad] with the angles of the mimic joints appended."""
        if not self.count:
            return position
        led = position[..., self._servos] * self._multiplier + self._offset
        # A column alone, as of a gripper's one servo, would make the result's columns contiguous.
        return np.ascontiguousarray(np.concatenate([position, led], -1))

    def folded(self, jacobian: Array) -> Array:
        """Returns the Jacobian (6, n_servos) of the servos, in which each servo also moves its mimic joints.
        The argument has additional columns for the mimic joints, after those of the servos."""
        if not self.count:
            return jacobian
        own, others = jacobian[:, : self._first].copy(), jacobian[:, self._first :] * self._multiplier
        np.add.at(own.T, self._servos, others.T)
        return own


@dataclass(frozen=True, slots=True)
class _Tables:
    """What all chains of one robot share. The dictionaries fill as links are asked for."""

    bodies: dict[str, int]
    mimics: _Mimics
    torso: int
    steps: Records
    sums: Array
    axes: Array
    after: Indices
    asked: dict[tuple[str, ...], tuple[Indices, Records]] = field(default_factory=dict)
    jacobians: dict[str, tuple[Indices, Records]] = field(default_factory=dict)
    chains: dict[str, tuple[int, ...]] = field(default_factory=dict)


@per_robot
def _tables(robot: Robot, _: tuple[int, ...]) -> _Tables:
    """The second argument has the times [ns] at which the model's files were last written."""
    assert robot.model is not None
    model = _shared_model(robot.model)
    bodies = {model.body(index).name: index for index in range(1, model.nbody)}
    if robot.model.torso_link not in bodies:
        raise UnknownNameError("link of the kinematic model", robot.model.torso_link, tuple(bodies))
    steps = _Steps(robot, model)
    torso = steps.add(steps.after[bodies[robot.model.torso_link]], _fixed(robot.model.T_LT))
    after = [steps.after[body] for body in range(model.nbody)]
    return _Tables(
        bodies, _Mimics(robot), torso, read_only(steps.steps, STEP), read_only(steps.sums),
        read_only(steps.axes), read_only(after, np.int64),
    )  # fmt: skip


class _Steps:
    """Table of all steps on the paths from the root of a model to its bodies. A step is a fixed offset or a
    joint."""

    def __init__(self, robot: Robot, model: mujoco.MjModel) -> None:
        servos, _, columns = joints_of(robot, model)
        servo_of = {int(model.dof_jntid[c]): servo for servo, c in zip(servos, columns, strict=True)}
        mimics = [one.joint for servo in robot.servos for one in servo.mimics]
        names = {model.joint(joint).name: joint for joint in range(model.njnt)}
        servo_of |= {names[name]: len(robot.servos) + k for k, name in enumerate(mimics) if name in names}
        self.steps: list[tuple[int, int, bool]] = []
        self.sums: list[Array] = []
        self.axes: list[Array] = []
        self.after = {0: -1}
        for body in range(1, model.nbody):  # a body's number is above its parent's
            step = self.add(self.after[int(model.body_parentid[body])], _fixed(_pose(model, body)))
            first = int(model.body_jntadr[body])
            for joint in range(first, first + int(model.body_jntnum[body])):
                if joint in servo_of:
                    step = self.add(
                        step, _moving(model, joint), servo_of[joint], model.jnt_type[joint] == _SLIDE,
                        np.array([model.jnt_axis[joint], model.jnt_pos[joint]]),
                    )  # fmt: skip
            self.after[body] = step

    def add(
        self, before: int, sums: Array, servo: int = -1, slides: bool = False, axis: Array | None = None
    ) -> int:
        """Appends a step, which is a fixed offset or a joint, and returns its index. `before` is the index of
        the previous step (-1 for the world), `servo` that of the joint's servo (-1 for none). `sums` and
        `axis` are explained in `KinematicChain.sums` and `pose_and_jacobian`."""
        self.steps.append((before, servo, slides))
        self.sums.append(sums)
        self.axes.append(np.zeros((2, 3)) if axis is None else axis)
        return len(self.steps) - 1


def joints_of(robot: Robot, model: mujoco.MjModel) -> tuple[list[int], list[int], list[int]]:
    """Returns the servos that have a joint in the model, and the indices of each joint in `qpos` and in
    MuJoCo's Jacobians.

    Raises DescriptionError for joints that the model lacks, or that are neither revolute nor prismatic.
    """
    joints = {joint.name: joint for joint in map(model.joint, range(model.njnt))}
    moving = [servo for servo in robot.servos if servo.joint is not None]
    faults = [
        Fault(0, f"servo {servo.name}: the model has no joint {servo.joint!r}; valid: {', '.join(joints)}")
        for servo in moving
        if servo.joint not in joints
    ]
    if faults:
        raise DescriptionError(robot.source, faults)
    own = [joints[str(servo.joint)] for servo in moving]
    faults = [
        Fault(0, f"servo {servo.name}: the joint {servo.joint!r} has several axes; valid: a hinge or a slide")
        for servo, joint in zip(moving, own, strict=True)
        if int(joint.type[0]) not in _ONE_AXIS
    ]
    if faults:
        raise DescriptionError(robot.source, faults)
    places = [int(joint.qposadr[0]) for joint in own]
    return [servo.index for servo in moving], places, [int(joint.dofadr[0]) for joint in own]


def bare_model(model: Model) -> mujoco.MjModel:
    """Returns a new model with bodies and joints only. No mesh is read to compile it."""
    return copy(_shared_model(model))


def _shared_model(model: Model) -> mujoco.MjModel:
    """Returns MuJoCo's form of a model, with bodies and joints only. All callers get the same object, so they
    must not modify it."""
    return _bare_model(model, written(model))


def written(model: Model) -> tuple[int, ...]:
    """Returns the times [ns] at which a model's files were last written; 0 for one that is missing."""
    files = [Path(one) for one in (model.path, *(one.path for one in model.attachments))]
    return tuple(file.stat().st_mtime_ns if file.is_file() else 0 for file in files)


@lru_cache(maxsize=16)
def _bare_model(model: Model, _: tuple[int, ...]) -> mujoco.MjModel:
    """Returns MuJoCo's form of a model, reduced to what kinematics need. The second argument has the times
    [ns] at which its files were last written, so that a changed file is read again."""
    spec = load_spec(model)
    useless = (spec.sensors, spec.actuators, spec.equalities, spec.tendons, spec.pairs, spec.excludes)
    for element in [element for group in (*useless, spec.geoms, spec.meshes) for element in group]:
        spec.delete(element)
    # Kinematics need no mass, but MuJoCo compiles no moving body without one.
    spec.compiler.boundmass, spec.compiler.boundinertia = BOUND_MASS, BOUND_INERTIA
    return compiled(spec, model)


def at_zero(model: mujoco.MjModel, joint: int) -> Array:
    """Returns the pose (4, 4) of a body while its hinge or slide joint is at 0, relative to the body's pose
    in the model file.

    This pose is the identity, unless the model gives the joint a reference angle.
    """
    still, cos, _ = _moving(model, joint)
    pose = np.eye(4)
    pose[:3] = still if model.jnt_type[joint] == _SLIDE else still + cos
    return pose


def _pose(model: mujoco.MjModel, body: int) -> Array:
    """Returns the pose (4, 4) of a body in its parent body while all joints are at zero."""
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_quat[body])
    return transform(rotation.reshape(3, 3), model.body_pos[body])


def _fixed(pose: Array) -> Array:
    return np.stack([pose[:3], np.zeros((3, 4)), np.zeros((3, 4))])


def turning(axis: Array) -> Array:
    """Returns K0, K1 and K2 (3, 3, 3): K0 + K1 cos q + K2 sin q is the rotation by q about the unit vector
    `axis` (3,)."""
    along = np.outer(axis, axis)
    return np.stack([along, np.eye(3) - along, np.cross(axis, np.eye(3)).T])


def _moving(model: mujoco.MjModel, joint: int) -> Array:
    a, point, zero = model.jnt_axis[joint], model.jnt_pos[joint], float(model.qpos0[model.jnt_qposadr[joint]])
    if model.jnt_type[joint] == _SLIDE:
        way = np.column_stack([np.zeros((3, 3)), a])
        return np.stack([np.eye(3, 4) - zero * way, way, np.zeros((3, 4))])
    still, cos, sin = (np.column_stack([R, -R @ point]) for R in turning(a))
    still[:, 3] += point
    c, s = np.cos(zero), np.sin(zero)
    return np.stack([still, c * cos - s * sin, s * cos + c * sin])
