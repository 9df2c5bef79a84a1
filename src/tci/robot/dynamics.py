"""Rigid-body dynamics of a robot in the order of its servos: the inertia matrix, and the torques due to
velocity and weight."""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from tci.errors import UnknownNameError
from tci.messages.frames import Array, frozen, read_only
from tci.robot.description import Robot
from tci.robot.gravity import STANDARD_GRAVITY, weighted_model
from tci.robot.joint_calibration import JointCalibration, Tool
from tci.robot.kernels.blow import Links, Posed
from tci.robot.kinematics import joints_of
from tci.support.engine import mujoco

UPRIGHT = read_only([0.0, 0.0, -STANDARD_GRAVITY])
"""Gravity minus acceleration (3,) [m/s2] of a torso that is upright and at rest."""


POSTURES = 256
"""Random postures among which the least and the largest inertia are looked for. With 16 of them the least is
up to 2.4 times larger on a G1, with 4096 up to 10 % smaller on an iCub."""


class Dynamics:
    """Inertia and bias torques by MuJoCo's composite-rigid-body and recursive Newton-Euler algorithms.

    The root of the model is fixed to the ground. The masses of tools and the inertia of rotors, both from the
    calibration, are included. Friction is not included. Servos without a joint in the model have neither
    inertia nor torque. The methods reuse memory, so each thread needs its own object.
    """

    def __init__(self, robot: Robot, calibration: JointCalibration) -> None:
        """Adds the tools and rotors of a `calibration` to the robot's model.

        Raises DescriptionError if the robot has no model, or if a link lacks the `<inertial>` that it needs.
        Raises UnknownNameError if the torso, or the link of a tool, is missing in the model.
        """
        self._made_of = robot, calibration
        self._model, self._torso = weighted_model(robot)
        assert robot.model is not None  # `weighted_model` raises an error for a robot without a model
        self._T_LT = robot.model.T_LT
        links = [self._model.body(index).name for index in range(1, self._model.nbody)]
        for link, tool in calibration.tools.items():
            if link not in links:
                raise UnknownNameError("link of a tool", link, links)
            self._add(self._model.body(link).id, tool.mass, np.array(tool.centre))
        servos, addresses, columns = joints_of(robot, self._model)
        self._model.dof_armature[columns] = calibration.values(robot, "rotor")[servos]
        self._data = mujoco.MjData(self._model)
        self._servos, self._addresses, self._columns = (
            np.array(one, np.intp) for one in (servos, addresses, columns)
        )
        self._square = np.ix_(self._columns, self._columns)
        self._full = np.zeros((self._model.nv, self._model.nv))
        self._bias = np.zeros(self._model.nv)
        self._n = len(robot.servos)
        data = self._data
        arrays = self._full, data.xipos, data.xanchor, data.xaxis
        self._posed = Posed(*[frozen(one.view()) for one in arrays])

    def __reduce__(self) -> tuple[type[Dynamics], tuple[Robot, JointCalibration]]:
        return type(self), self._made_of  # copies of this object share no memory

    def at(self, position: Array, velocity: Array, gravity: Array | None = None) -> tuple[Array, Array]:
        """Returns the inertia matrix M (n, n) [kg m2] and the bias torques C v + g (n,) [N m] of all servos.

        `position` (n,) [rad] and `velocity` (n,) [rad/s] are in the order of `Robot.servos`. `gravity` (3,)
        [m/s2] is gravity minus the acceleration of the model's root link, in the frame of this link. By
        default the torso is upright and at rest.
        """
        model, data = self._model, self._data
        self.posed(position)
        data.qvel[self._columns] = velocity[self._servos]
        R_WT = data.xmat[self._torso].reshape(3, 3) @ self._T_LT[:3, :3]
        model.opt.gravity[:] = R_WT @ UPRIGHT if gravity is None else gravity
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, self._bias)
        inertia, bias = np.zeros((self._n, self._n)), np.zeros(self._n)
        inertia[np.ix_(self._servos, self._servos)] = self._full[self._square]
        bias[self._servos] = self._bias[self._columns]
        return inertia, bias

    def posed(self, position: Array) -> Posed:
        """MuJoCo's arrays at `position` (n,) [rad]; the next call of any method overwrites them."""
        model, data = self._model, self._data
        data.qpos[self._addresses] = position[self._servos]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_fullM(model, data, self._full)
        return self._posed

    def by_freedom(self, values: Array) -> Array:
        """`values` (n,) of servos in the order of MuJoCo's degrees of freedom, 0 for one without a servo."""
        found = np.zeros(self._model.nv)
        found[self._columns] = values[self._servos]
        return frozen(found)

    def links(self, servos: Collection[int]) -> Links:
        """The links with a mass whose own joint one of `servos` moves."""
        model = self._model
        driven = dict(zip(self._columns.tolist(), self._servos.tolist(), strict=True))
        last = (model.body_dofadr + model.body_dofnum - 1).tolist()
        bodies = [
            body
            for body in range(1, model.nbody)
            if model.body_dofnum[body] and driven.get(last[body]) in servos and model.body_mass[body] > 0.0
        ]
        carries = np.zeros((len(bodies), model.nv), np.bool_)
        for row, body in zip(carries, bodies, strict=True):
            freedom = last[body]
            while freedom >= 0:
                row[freedom] = freedom in driven
                freedom = int(model.dof_parentid[freedom])
        joints = model.dof_jntid
        slides = model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_SLIDE
        return Links(
            read_only(bodies, np.int64), read_only(carries, np.bool_), read_only(joints, np.int64),
            read_only(slides, np.bool_),
        )  # fmt: skip

    def turned(self, link: str) -> Array:
        """How a link is turned (3, 3) in the posture of the last `at`, in the frame of the model's root."""
        turned: Array = self._data.body(link).xmat.reshape(3, 3).copy()
        return turned

    def moved(self, link: str, point: Array) -> Array:
        """Jacobian (3, n) [m/rad] of a point (3,) [m] of a link, in the posture of the last `at`. The point
        is in the link's frame, the Jacobian in that of the model's root."""
        model, data = self._model, self._data
        body = model.body(link).id
        whole, one = np.zeros((3, model.nv)), np.zeros((3, self._n))
        mujoco.mj_jac(model, data, whole, None, data.xpos[body] + self.turned(link) @ point, body)
        one[:, self._servos] = whole[:, self._columns]
        return one

    def _add(self, body: int, mass: float, centre: Array) -> None:
        """Adds a point mass to a body of the MuJoCo model: `mass` [kg] at the point `centre` (3,) [m] in the
        frame of the body. `body` is the index of the body in the model."""
        model = self._model
        own, before = float(model.body_mass[body]), model.body_ipos[body].copy()
        entries = np.empty(9)
        mujoco.mju_quat2Mat(entries, model.body_iquat[body])
        R_BI = entries.reshape(3, 3)
        apart = centre - before
        lever = own * mass / (own + mass) * (apart @ apart * np.eye(3) - np.outer(apart, apart))
        values, axes = np.linalg.eigh(R_BI @ np.diag(model.body_inertia[body]) @ R_BI.T + lever)
        axes[:, 2] *= np.linalg.det(axes)
        model.body_mass[body] = own + mass
        model.body_ipos[body] = (own * before + mass * centre) / (own + mass)
        model.body_inertia[body] = values
        mujoco.mju_mat2Quat(model.body_iquat[body], axes.ravel())


class InertiaRange(NamedTuple):
    """What the inertia of a robot's links may be, over the postures that its limits allow."""

    least: Array
    """Least diagonal entries (n,) [kg m2]; NaN for servos without a joint in the model."""
    largest: Array
    """Largest absolute entries (n, n) [kg m2]; 0 for servos without a joint in the model."""


@lru_cache(maxsize=8)
def inertia_range(robot: Robot, loads: tuple[tuple[str, Tool], ...] = ()) -> InertiaRange:
    """Range of the inertia of the links and of `loads` that they carry.

    Motors are left out: too small a least value makes a limit of torques safe, too large a value does not.
    Raises the errors that `Dynamics` raises.
    """
    dynamics = Dynamics(robot, JointCalibration(robot=robot.name, tools=dict(loads)))
    limits = [servo.limits for servo in robot.servos]
    lower, upper = (
        np.array([getattr(one, end) if getattr(one, end) is not None else 0.0 for one in limits])
        for end in ("lower", "upper")
    )
    random, still = np.random.default_rng(0), np.zeros(len(limits))
    postures = random.uniform(lower, np.maximum(lower, upper), (POSTURES, len(limits)))
    inertias = np.array([dynamics.at(posture, still)[0] for posture in postures])
    least = inertias.diagonal(axis1=1, axis2=2).min(axis=0)
    largest = np.abs(inertias).max(axis=0)
    return InertiaRange(read_only(np.where(least > 0.0, least, np.nan)), read_only(largest))
