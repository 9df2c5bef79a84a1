"""The MuJoCo scene of a world, from a robot's description only: no line here knows a robot."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from tci.errors import DescriptionError, Fault
from tci.frames import Array
from tci.model.description import Robot
from tci.model.mujoco_model import load_spec
from tci.model.surfaces import Surface
from tci.simulation.collisions import exclude_overlaps, set_self_collisions
from tci.simulation.finger import add_finger
from tci.simulation.touch import add_skin

NO_MODEL = "no <model>: a simulation needs a URDF or MJCF file"

HULL_VERTICES = 64
"""Vertices of a mesh's convex hull that collisions use. Ours: more cost time and show nowhere."""


def build_scene(
    robot: Robot, surfaces: Mapping[str, Surface], posture: Array, *, step: float
) -> mujoco.MjModel:
    """The robot on a fixed base, its servos, its skin and a finger, ready to simulate.

    `posture` (n_servos,) [rad] is the one in which links that overlap are taken to be built so.
    Joints that are no servo's are held at 0. Raises DescriptionError when the robot has no model.
    """
    if robot.model is None:
        raise DescriptionError(robot.source, [Fault(0, NO_MODEL)])
    spec = load_spec(robot.model)
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _keep_only_servos(spec, robot)
    _add_servos(spec, robot)
    for body in spec.bodies:
        # A real servo's integral action carries the weight in the end; here gravity is taken off, so
        # that a held posture is met exactly, and from the start.
        body.gravcomp = 1.0
    for mesh in spec.meshes:
        mesh.maxhullvert = HULL_VERTICES
    set_self_collisions(spec, robot)
    for patch in robot.patches:
        if patch.name in surfaces:
            add_skin(spec, surfaces[patch.name])
    add_finger(spec, step=step)
    return exclude_overlaps(spec, robot, posture)


def _keep_only_servos(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Delete joints that no servo drives, and all that acts on joints beside our servos."""
    groups = (spec.actuators, spec.sensors, spec.keys, spec.tendons, spec.equalities, spec.pairs)
    for element in [element for group in groups for element in group]:
        spec.delete(element)
    driven = {servo.joint for servo in robot.servos}
    for joint in list(spec.joints):
        if joint.name not in driven:
            spec.delete(joint)


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
