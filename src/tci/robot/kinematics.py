"""Forward kinematics and Jacobians: where the links of a robot are, and how its servos move them."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.engine import mujoco
from tci.errors import CommandError, DescriptionError, Fault, UnknownNameError
from tci.frames import Array
from tci.robot.description import Model, Robot
from tci.robot.model_file import compiled, load_spec

_ORIGIN = np.zeros(3)
_ONE_AXIS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


class Kinematics:
    """Poses of a robot's links, from MuJoCo's forward kinematics of its model.

    An object works in its own memory: use one per thread. What `poses` returns is the caller's.
    """

    def __init__(self, robot: Robot) -> None:
        """Raises DescriptionError when the robot has no model, or the model lacks a joint or the torso."""
        if robot.model is None:
            raise DescriptionError(
                robot.source, [Fault(0, "no <model>: kinematics need a URDF or MJCF file")]
            )
        self.model = bare_model(robot.model)
        """Its bodies and joints, nothing else."""
        self._data = mujoco.MjData(self.model)
        self._qpos = self._data.qpos
        self._positions = self._data.xpos
        self._rotations = self._data.xmat.reshape(-1, 3, 3)
        names = [self.model.body(index).name for index in range(self.model.nbody)]
        self._bodies = {name: index for index, name in enumerate(names) if index > 0}
        self.links: tuple[str, ...] = tuple(self._bodies)
        """Names of all links, in the model's order."""
        self._torso = self.body(robot.model.torso_link)
        self._R_LT = robot.model.T_LT[:3, :3]
        self._p_LT = robot.model.T_LT[:3, 3]
        self.n_servos = len(robot.servos)
        """How many servos the robot has: the length of every `position`."""
        self._servos, self._addresses, self._columns = joints_of(robot, self.model)
        self._moving, self._places = np.array(self._servos, np.intp), np.array(self._addresses, np.intp)
        self._asked: dict[tuple[str, ...], NDArray[np.intp]] = {}
        self._jacobian = np.zeros((6, self.model.nv))
        self._carried = np.zeros((6, self.model.nv))

    def poses(self, position: Array, links: Iterable[str]) -> dict[str, Array]:
        """`T_TL` (4, 4) of each of `links`, seen from the torso.

        `position` (n_servos,) [rad] is in the order of `Robot.servos`; servos that have no joint in
        the model do not count. Raises CommandError for another shape, UnknownNameError for a link
        that the model lacks.
        """
        names = tuple(links)
        bodies = self._asked.get(names)
        if bodies is None:
            bodies = self._asked[names] = np.array([self.body(name) for name in names], np.intp)
        self._move(position)
        R_WT, p_WT = self._torso_pose()
        T_TL = np.zeros((len(names), 4, 4))
        T_TL[:, :3, :3] = R_WT.T @ self._rotations[bodies]
        T_TL[:, :3, 3] = (self._positions[bodies] - p_WT) @ R_WT
        T_TL[:, 3, 3] = 1.0
        return dict(zip(names, T_TL, strict=True))

    def jacobian(self, position: Array, link: str, *, point: Array = _ORIGIN) -> Array:
        """Jacobian (6, n_servos) of a point of `link`, seen from the torso.

        Rows 0-2 are the velocity of the point [m/rad], rows 3-5 the angular velocity of the link, per
        rad/s of each servo, both relative to the torso and along its axes. `point` (3,) [m] is given
        in `link`: a taxel's position is one. Raises what `poses` raises, and CommandError for a point
        of another shape.
        """
        return self.pose_and_jacobian(position, link, point=point)[1]

    def pose_and_jacobian(self, position: Array, link: str, *, point: Array = _ORIGIN) -> tuple[Array, Array]:
        """`T_TP` (4, 4), the link's orientation at `point`, and what `jacobian` returns, in one go."""
        if np.shape(point) != (3,):
            raise CommandError(f"point of shape {np.shape(point)}; valid: (3,)")
        body = self.body(link)
        self._move(position)
        mujoco.mj_comPos(self.model, self._data)
        R_WL = self._rotations[body]
        p_WP = self._positions[body] + R_WL @ point
        # The torso itself may hang on servos (an iCub's chest): take off how it would carry the point.
        mujoco.mj_jac(self.model, self._data, self._jacobian[:3], self._jacobian[3:], p_WP, body)
        mujoco.mj_jac(self.model, self._data, self._carried[:3], self._carried[3:], p_WP, self._torso)
        R_WT, p_WT = self._torso_pose()
        T_TP = np.eye(4)
        T_TP[:3, :3] = R_WT.T @ R_WL
        T_TP[:3, 3] = (p_WP - p_WT) @ R_WT
        moving = (self._jacobian - self._carried)[:, self._columns]
        result = np.zeros((6, self.n_servos))
        result[:3, self._servos] = R_WT.T @ moving[:3]
        result[3:, self._servos] = R_WT.T @ moving[3:]
        return T_TP, result

    def chain(self, link: str) -> tuple[int, ...]:
        """Servos that move `link` relative to the torso, in order from the torso. UnknownNameError."""
        up, down = self._ancestors(self._torso), self._ancestors(self.body(link))
        shared = set(up) & set(down)
        path = [body for body in up if body not in shared]
        path += [body for body in reversed(down) if body not in shared]
        servo_of = {column: servo for servo, column in zip(self._servos, self._columns, strict=True)}
        columns: list[int] = []
        for body in path:
            first, count = int(self.model.body_dofadr[body]), int(self.model.body_dofnum[body])
            own = list(range(first, first + count))
            columns += own[::-1] if body in up else own
        return tuple(servo_of[column] for column in columns if column in servo_of)

    def _ancestors(self, body: int) -> list[int]:
        """The body and those that carry it, up to but without the world."""
        result = []
        while body > 0:
            result.append(body)
            body = int(self.model.body_parentid[body])
        return result

    def _move(self, position: Array) -> None:
        if np.shape(position) != (self.n_servos,):
            raise CommandError(
                f"position of shape {np.shape(position)}; the robot has {self.n_servos} servos"
            )
        self._qpos[self._places] = position[self._moving]
        mujoco.mj_kinematics(self.model, self._data)

    def _torso_pose(self) -> tuple[Array, Array]:
        """`R_WT` (3, 3) and `p_WT` (3,) [m] of the torso in MuJoCo's world."""
        R_WL = self._rotations[self._torso]
        return R_WL @ self._R_LT, self._positions[self._torso] + R_WL @ self._p_LT

    def body(self, link: str) -> int:
        """Index of a link in the model. Raises UnknownNameError."""
        try:
            return self._bodies[link]
        except KeyError:
            raise UnknownNameError("link of the kinematic model", link, self.links) from None


def joints_of(robot: Robot, model: mujoco.MjModel) -> tuple[list[int], list[int], list[int]]:
    """Servos with a joint in the model, the place of each in MuJoCo's coordinates, and in its Jacobians.

    Raises DescriptionError for every joint that the model lacks, or that neither turns nor slides.
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
    """Bodies and joints only: it compiles without reading a mesh. It is the caller's."""
    file = Path(model.path)
    return copy(_bare_model(model, file.stat().st_mtime_ns if file.is_file() else 0))


@lru_cache(maxsize=16)
def _bare_model(model: Model, written: int) -> mujoco.MjModel:
    """That of a file `written` at a time [ns]; each trial asks for it, and an iCub's takes 60 ms."""
    spec = load_spec(model)
    useless = (spec.sensors, spec.actuators, spec.equalities, spec.tendons, spec.pairs, spec.excludes)
    for element in [element for group in (*useless, spec.geoms, spec.meshes) for element in group]:
        spec.delete(element)
    # Kinematics need no mass, but MuJoCo compiles no moving body without one.
    spec.compiler.boundmass = 1e-6
    spec.compiler.boundinertia = 1e-9
    return compiled(spec, model)
