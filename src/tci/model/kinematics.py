"""Forward kinematics: where the links of a robot are, seen from its torso."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from tci.errors import CommandError, DescriptionError, Fault, UnknownNameError
from tci.frames import Array
from tci.model.description import Model, Robot
from tci.model.mujoco_model import load_spec


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
        self._model = _bare_model(robot.model)
        self._data = mujoco.MjData(self._model)
        self._qpos = self._data.qpos
        self._positions = self._data.xpos
        self._rotations = self._data.xmat.reshape(-1, 3, 3)
        names = [self._model.body(index).name for index in range(self._model.nbody)]
        self._bodies = {name: index for index, name in enumerate(names) if index > 0}
        self.links: tuple[str, ...] = tuple(self._bodies)
        """Names of all links, in the model's order."""
        self._torso = self._body(robot.model.torso_link)
        self._R_LT = robot.model.T_LT[:3, :3]
        self._p_LT = robot.model.T_LT[:3, 3]
        self._n_servos = len(robot.servos)
        self._servos, self._addresses = self._joints(robot)

    def poses(self, position: Array, links: Iterable[str]) -> dict[str, Array]:
        """`T_TL` (4, 4) of each of `links`, seen from the torso.

        `position` (n_servos,) [rad] is in the order of `Robot.servos`; servos that have no joint in
        the model do not count. Raises CommandError for another shape, UnknownNameError for a link
        that the model lacks.
        """
        if np.shape(position) != (self._n_servos,):
            raise CommandError(
                f"position of shape {np.shape(position)}; the robot has {self._n_servos} servos"
            )
        names = list(links)
        bodies = [self._body(name) for name in names]
        self._qpos[self._addresses] = position[self._servos]
        mujoco.mj_kinematics(self._model, self._data)
        R_WT = self._rotations[self._torso] @ self._R_LT
        p_WT = self._positions[self._torso] + self._rotations[self._torso] @ self._p_LT
        T_TL = np.zeros((len(names), 4, 4))
        T_TL[:, :3, :3] = R_WT.T @ self._rotations[bodies]
        T_TL[:, :3, 3] = (self._positions[bodies] - p_WT) @ R_WT
        T_TL[:, 3, 3] = 1.0
        return dict(zip(names, T_TL, strict=True))

    def _body(self, link: str) -> int:
        try:
            return self._bodies[link]
        except KeyError:
            raise UnknownNameError("link of the kinematic model", link, self.links) from None

    def _joints(self, robot: Robot) -> tuple[list[int], list[int]]:
        """Servos with a joint in the model, and the place of each in MuJoCo's coordinates."""
        joints = [self._model.joint(index) for index in range(self._model.njnt)]
        places = {joint.name: int(joint.qposadr[0]) for joint in joints}
        moving = [servo for servo in robot.servos if servo.joint is not None]
        faults = [
            Fault(
                0, f"servo {servo.name}: the model has no joint {servo.joint!r}; valid: {', '.join(places)}"
            )
            for servo in moving
            if servo.joint not in places
        ]
        if faults:
            raise DescriptionError(robot.source, faults)
        return [servo.index for servo in moving], [places[str(servo.joint)] for servo in moving]


def _bare_model(model: Model) -> mujoco.MjModel:
    """Bodies and joints only: it compiles without reading a mesh."""
    spec = load_spec(model)
    useless = (spec.sensors, spec.actuators, spec.equalities, spec.tendons, spec.pairs, spec.excludes)
    for element in [element for group in (*useless, spec.geoms, spec.meshes) for element in group]:
        spec.delete(element)
    # Kinematics need no mass, but MuJoCo compiles no moving body without one.
    spec.compiler.boundmass = 1e-6
    spec.compiler.boundinertia = 1e-9
    return spec.compile()
