"""Selection of the bodies of a robot that collide: its arms with its trunk, and with each other.

Links next to a joint overlap by construction. So links of one arm do not collide with each other, and the
first link of an arm does not collide at all. Links that overlap in the initial posture do not collide either,
nor do links that are near each other in nearly all postures, such as the second link of a shoulder that turns
in a recess of the torso.
"""

from __future__ import annotations

import numpy as np

from tci.engine import mujoco
from tci.errors import DescriptionError, Fault
from tci.frames import Array
from tci.robot.description import Robot
from tci.robot.hulls import HULL_VERTICES, keep_hulls
from tci.robot.kinematics import joints_of
from tci.robot.model_file import compiled, load_spec

LEFT, RIGHT, SKIN, GROUND = 1, 2, 4, 8
"""Bits of MuJoCo's contype and conaffinity. Skin collides with the finger only; the skin of soles also with
the ground."""

HIDDEN = 3
"""Number of the geom group that pictures leave out."""

NEAR = 0.01
"""Distance [m] within which links count as near each other. Assumed: twice the distance that the gate
keeps."""
POSTURES, MOST = 32, 0.9
"""Number of random postures in which near links are compared, and the fraction in which they are near by
construction. Assumed: links that can collide by motion are near in few postures."""

NO_MODEL = "no <model>: simulation and self-collision need a URDF or MJCF file"


def solid_spec(robot: Robot, *, shown: bool = False, mimics: bool = True) -> mujoco.MjSpec:
    """Returns the robot's model with its servos' joints only, and with the geoms that collide marked.

    With `shown` the model contains everything for pictures; otherwise only colliding geoms, as convex hulls.
    Joints that are not driven by a servo are fixed at 0; without `mimics`, so are joints that only follow a
    servo. No force acts on any joint. Raises DescriptionError if the robot has no model, and the errors of
    `load_spec`.
    """
    if robot.model is None:
        raise DescriptionError(robot.source, [Fault(0, NO_MODEL)])
    spec = load_spec(robot.model)
    groups = (spec.actuators, spec.sensors, spec.tendons, spec.equalities, spec.pairs)
    for element in [element for group in groups for element in group]:
        spec.delete(element)
    driven = {servo.joint for servo in robot.servos}
    if mimics:
        driven |= {one.joint for servo in robot.servos for one in servo.mimics}
    for joint in list(spec.joints):
        if joint.name not in driven:
            spec.delete(joint)
    for mesh in spec.meshes:
        mesh.maxhullvert = HULL_VERTICES
    if not shown:
        keep_hulls(spec)
    _set_self_collisions(spec, robot)
    return spec


def _set_self_collisions(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Sets the bits of each geom of the model. Geoms that do not collide in the model file never collide."""
    arms = _arms(spec, robot)
    solid = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
    shown = [geom for geom in spec.geoms if not (geom.contype or geom.conaffinity)]
    # URDF models show a mesh by one geom and use another for its collisions.
    meshes = {(geom.parent.name, geom.meshname) for geom in shown if geom.meshname}
    for geom in solid:
        if (geom.parent.name, geom.meshname) in meshes:
            geom.group = HIDDEN
        arm, distance = arms.get(geom.parent.name, (0, 0))
        if not arm:
            geom.contype, geom.conaffinity = 0, LEFT | RIGHT
        elif distance > 1:
            geom.contype, geom.conaffinity = arm, RIGHT if arm == LEFT else LEFT
        else:
            geom.contype, geom.conaffinity = 0, 0


def exclude_overlaps(spec: mujoco.MjSpec, robot: Robot, posture: Array) -> mujoco.MjModel:
    """Compiles the model after excluding pairs of bodies that overlap at `posture` (n_servos,) [rad], or that
    are near each other there and in most other postures.

    Raises DescriptionError for a mesh that MuJoCo can't read, or when the model lacks a joint.
    """
    assert robot.model is not None  # solid_spec has raised
    model = compiled(spec, robot.model)
    pairs = _overlapping(model, robot, posture)
    if not pairs:
        return model
    for first, second in pairs:
        spec.add_exclude(bodyname1=model.body(first).name, bodyname2=model.body(second).name)
    del model  # an iCub's takes 50 MB
    return compiled(spec, robot.model)


def nearby(
    model: mujoco.MjModel, robot: Robot, posture: Array, *, within: float | None = None
) -> dict[tuple[int, int], float]:
    """Returns the least distance [m] of each pair of bodies, by MuJoCo's number, that are `within` a distance
    [m] at `posture` (n_servos,) [rad]; None for the margins of the model's geoms."""
    data = mujoco.MjData(model)
    servos, addresses, _ = joints_of(robot, model)
    data.qpos[addresses] = posture[servos]
    margin = model.geom_margin.copy()
    if within is not None:
        model.geom_margin[:] = within
    mujoco.mj_fwdPosition(model, data)
    model.geom_margin[:] = margin
    contacts = data.contact
    bodies = np.sort(model.geom_bodyid[contacts.geom[: data.ncon]], axis=1).tolist()
    found: dict[tuple[int, int], float] = {}
    for (low, high), distance in zip(bodies, contacts.dist[: data.ncon].tolist(), strict=True):
        if within is None or distance < within:
            found[low, high] = min(distance, found.get((low, high), np.inf))
    return found


def _overlapping(model: mujoco.MjModel, robot: Robot, posture: Array) -> list[tuple[int, int]]:
    """Returns the pairs of bodies, by MuJoCo's number, that are in contact at `posture`, or near each other
    by construction."""
    overlapping = set(nearby(model, robot, posture))
    if near := nearby(model, robot, posture, within=NEAR).keys() - overlapping:
        ends = np.array([posture, posture])
        for servo in robot.servos:
            if servo.limits.lower is not None and servo.limits.upper is not None:
                ends[:, servo.index] = servo.limits.lower, servo.limits.upper
        others = np.random.default_rng(0).uniform(ends[0], ends[1], (POSTURES, len(posture)))
        seen = [nearby(model, robot, angles, within=NEAR) for angles in others]
        for pair in near:
            beside = sum(abs(distances.get(pair, np.inf)) < NEAR for distances in seen)
            if beside >= MOST * POSTURES:
                overlapping.add(pair)
    return sorted(overlapping)


def _arms(spec: mujoco.MjSpec, robot: Robot) -> dict[str, tuple[int, int]]:
    """Maps each body that an arm's joints move to the arm's bit and the number of the arm's joints up to that
    body."""
    found = {}
    for part in robot.parts:
        if part.kind != "arm":
            continue
        bit = LEFT if part.side == "left" else RIGHT
        servos = [robot.servos[servo.servo] for servo in part.servos if servo.servo is not None]
        names = {servo.joint for servo in servos}
        for body in spec.bodies:
            distance = 0
            above = body
            while above is not None and above.name != "world":
                distance += sum(joint.name in names for joint in above.joints)
                above = above.parent
            if distance:
                found[body.name] = bit, distance
    return found
