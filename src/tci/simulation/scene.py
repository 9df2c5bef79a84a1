"""The MuJoCo scene of a world, from a robot's description only: no line here knows a robot."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from tci.frames import Array
from tci.model.collisions import exclude_overlaps, solid_spec
from tci.model.description import Robot
from tci.model.surfaces import Surface
from tci.simulation.finger import add_finger
from tci.simulation.touch import add_skin


def build_scene(
    robot: Robot, surfaces: Mapping[str, Surface], posture: Array, *, step: float
) -> mujoco.MjModel:
    """The robot on a fixed base, its servos, its skin and a finger, ready to simulate.

    `posture` (n_servos,) [rad] is the one in which links that overlap are taken to be built so.
    Raises DescriptionError when the robot has no model.
    """
    spec = solid_spec(robot)
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _add_servos(spec, robot)
    for body in spec.bodies:
        # A real servo's integral action carries the weight in the end; here gravity is taken off, so
        # that a held posture is met exactly, and from the start.
        body.gravcomp = 1.0
    for patch in robot.patches:
        if patch.name in surfaces:
            add_skin(spec, surfaces[patch.name], axes=patch.sensor.axes, step=step)
    add_finger(spec, step=step)
    return exclude_overlaps(spec, robot, posture)


def _add_servos(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Limits of the description, and a position actuator for each servo; `Servos` sets its gains."""
    # A specification keeps angles in its file's unit until it is compiled.
    unit = np.rad2deg(1.0) if spec.compiler.degree else 1.0
    for servo in robot.servos:
        if servo.joint is None:
            continue
        joint = spec.joint(servo.joint)
        limits = servo.limits
        if limits.lower is not None and limits.upper is not None:
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            joint.range = np.array([limits.lower, limits.upper]) * unit
        joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
        actuator = spec.add_actuator(name=servo.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=servo.joint)
        actuator.set_to_position(kp=1.0, kv=1.0)
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        actuator.forcerange = np.array([-1.0, 1.0])
