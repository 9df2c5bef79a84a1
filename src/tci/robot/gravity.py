"""Gravity torques: the torques with which the servos hold the weight of the links."""

from __future__ import annotations

from copy import copy
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError, DescriptionError, Fault, UnknownNameError
from tci.messages.frames import Array, read_only
from tci.robot.description import Model, Robot
from tci.robot.kinematics import KinematicChain, bare_model, joints_of, written
from tci.robot.like import RobotLike, as_robot
from tci.robot.model_file import load_spec
from tci.support.engine import mujoco

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of gravity [m/s2] (3rd CGPM, 1901)."""

DOWN = read_only([0.0, 0.0, -1.0])
"""Direction of gravity in the torso frame of a robot that stands upright."""


class Gravity:
    """Gravity torques from the masses of the model, by MuJoCo's recursive Newton-Euler algorithm at zero
    velocity.

    The methods reuse memory, so each thread needs its own object. Returned arrays are copies.
    """

    def __init__(self, robot: RobotLike) -> None:
        """Reads the model. Raises DescriptionError if the robot has no model, or if the model lacks the joint
        of a servo or the mass of a moved link. Raises UnknownNameError if the model lacks the torso."""
        robot = as_robot(robot)
        self._model, self._torso = weighted_model(robot)
        assert robot.model is not None  # `weighted_model` raises an error for a robot without a model
        self._data = mujoco.MjData(self._model)
        self._T_LT = robot.model.T_LT
        self._n_servos = len(robot.servos)
        self._servos, self._addresses, self._columns = joints_of(robot, self._model)
        self._kinematics = KinematicChain(robot)
        self.masses: Array = read_only(self._model.body_mass)
        """Mass (n_bodies,) [kg] of each body of the model."""
        self._heavy = np.flatnonzero(self.masses)

    def torques(self, position: ArrayLike, *, down: ArrayLike = DOWN) -> Array:
        """Returns the torque (n_servos,) [N m] that each servo needs to hold `position` (n_servos,) [rad].

        `down` (3,) is the direction of gravity in the torso frame; its length has no effect. The root of the
        model counts as fixed to the ground, so an iCub's waist holds the upper body but not the legs. For
        servos without a joint in the model the torque is 0. Raises CommandError if an argument has another
        shape, or if `down` has length 0.
        """
        if np.shape(position) != (self._n_servos,):
            raise CommandError(
                f"position of shape {np.shape(position)}; the robot has {self._n_servos} servos"
            )
        length = float(np.linalg.norm(down)) if np.shape(down) == (3,) else 0.0
        if not 0.0 < length < np.inf:
            raise CommandError(f"direction of gravity {down!r}; valid: a vector (3,) that is not zero")
        self._data.qpos[self._addresses] = np.asarray(position)[self._servos]
        mujoco.mj_kinematics(self._model, self._data)
        R_WT = self._data.xmat[self._torso].reshape(3, 3) @ self._T_LT[:3, :3]
        self._model.opt.gravity[:] = R_WT @ np.asarray(down) * (STANDARD_GRAVITY / length)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_comVel(self._model, self._data)
        held = np.zeros(self._model.nv)
        mujoco.mj_rne(self._model, self._data, 0, held)
        result = np.zeros(self._n_servos)
        result[self._servos] = held[self._columns]
        return result

    def centre_of_mass(self, position: ArrayLike) -> Array:
        """Returns the centre of mass (3,) [m] of the whole robot at `position` (n_servos,) [rad], in the
        torso frame."""
        poses = self._kinematics.body_poses(position, self._heavy.tolist())
        masses = self.masses[self._heavy]
        centres = np.einsum("bij,bj->bi", poses[:, :3, :3], self._model.body_ipos[self._heavy])
        centre: Array = masses @ (centres + poses[:, :3, 3]) / masses.sum()
        return centre


def weighted_model(robot: Robot) -> tuple[mujoco.MjModel, int]:
    """Returns a model of the robot with bodies, joints, masses and gravity, and the index of its torso body.

    - Raises DescriptionError if the robot has no model, or if nothing tells the mass of a link that a joint
      moves or that has shapes (MJCF).
    - Raises UnknownNameError if the torso is missing in the model.
    """
    if robot.model is None:
        raise DescriptionError(robot.source, [Fault(0, "no <model>: gravity needs a URDF or MJCF file")])
    model, torso = _weighted_model(robot.model, written(robot.model))
    return copy(model), torso


@lru_cache(maxsize=16)
def _weighted_model(description: Model, _: tuple[int, ...]) -> tuple[mujoco.MjModel, int]:
    """Returns the MuJoCo model that `description` names, with masses and gravity, and the index of its torso
    body. The second argument has the times [ns] at which its files were last written, so that a changed file
    is read again. Callers must not modify the model."""
    model = bare_model(description)
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    links = [model.body(index).name for index in range(1, model.nbody)]
    if description.torso_link not in links:
        raise UnknownNameError("link of the kinematic model", description.torso_link, links)
    torso = model.body(description.torso_link).id
    spec = load_spec(description)  # its elements must not outlive it
    heavy = {body.name for body in spec.bodies if body.explicitinertial}
    shaped = {
        body.name for body in spec.bodies if any(geom.mass != 0 and geom.density for geom in body.geoms)
    }
    weighed = (
        "an <inertial>" if description.format == "urdf" else "an <inertial>, or geoms that MuJoCo weighs"
    )
    faults = []
    for body, name in enumerate(links, start=1):
        if name not in heavy:
            # The model compiler gave this body a placeholder mass, which would add to the weight.
            model.body_mass[body] = 0.0
            model.body_inertia[body] = 0.0
            of_robot = model.body_rootid[body] == model.body_rootid[torso]
            if model.body_jntnum[body]:
                faults.append(Fault(0, f"link {name} moves and has no <inertial>; valid: {weighed}"))
            elif description.format == "mjcf" and of_robot and name in shaped:
                fault = f"link {name} has shapes and no <inertial> that says their weight; valid: {weighed}"
                faults.append(Fault(0, fault))
    if faults:
        raise DescriptionError(description.path, faults)
    return model, torso
