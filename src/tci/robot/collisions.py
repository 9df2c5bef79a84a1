"""Selection of the links of a robot that can collide: the arms with all other links, and the arms with each
other.

An arm that stands alone can also collide with the table, wall or ceiling that carries it. Links next to a
joint overlap by construction, so these collisions are excluded:

- links of one arm with each other
- the first link of an arm with any link
- links that overlap in the initial posture
- links that are near each other in nearly all postures, such as the second link of a shoulder that turns in a
  recess of the torso
"""

from __future__ import annotations

import numpy as np

from tci.errors import DescriptionError, Fault
from tci.messages.frames import Array
from tci.robot.description import Grid, Patch, Robot
from tci.robot.hulls import HULL_VERTICES, keep_hulls
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import bare_model, joints_of
from tci.robot.model_file import compiled, load_spec
from tci.robot.mounting import add_mounting
from tci.support.engine import mujoco

LEFT, RIGHT, SKIN, GROUND, PERSON = 1, 2, 4, 8, 16
"""Bits of MuJoCo's `contype` and `conaffinity`, which select the geoms that collide with each other: those of
the arms, the simulated finger with skin, the ground with soles, people and things with all of the robot."""
HANDS = [PERSON << number for number in range(1, 9)]
"""Bits of single hands: a hand that touches skin passes through the bare hulls of this link."""
ALL_PEOPLE = PERSON | sum(HANDS)

HIDDEN = 3
"""Number of the geom group that is left out of pictures."""

NEAR = 0.01
"""Distance [m] below which links count as near each other. Assumed: twice the distance that the gate keeps
between links."""
POSTURES, MOST = 32, 0.9
"""POSTURES: number of random postures in which the distances of links are computed. MOST: links that are near
each other in at least this fraction of the postures are near by construction. Assumed: links that only a
motion brings together are near each other in few postures."""

NO_MODEL = "no <model>: simulation and self-collision need a URDF or MJCF file"


def solid_spec(
    robot: Robot, *, shown: bool = False, mimics: bool = True, mounted: bool = True
) -> mujoco.MjSpec:
    """Returns the robot's model with only the joints of its servos. The attributes `contype` and
    `conaffinity` of each geom define with which other geoms it can collide.

    If `shown` is True, the model contains everything that pictures need; otherwise it contains only the geoms
    that collide, as convex hulls. Joints that no servo drives are fixed at 0. If `mimics` is False, joints
    that only follow a servo are fixed too: those that turn at 0, those that slide, as jaws do, as they are in
    the initial posture. With `mounted`, what carries an arm is a body of the model. The model contains no
    actuators, sensors, tendons and equality constraints.

    Raises DescriptionError if the robot has no model, and the errors that `load_spec` raises.
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
    else:
        _slide_to_start(spec, robot)
    for joint in list(spec.joints):
        if joint.name not in driven:
            spec.delete(joint)
    for mesh in spec.meshes:
        mesh.maxhullvert = HULL_VERTICES
    if not shown:
        keep_hulls(spec)
    for patch in thick_pads(robot):
        _add_pad(spec, patch)
    if mounted:
        add_mounting(spec, robot.model, group=HIDDEN)
    _set_self_collisions(spec, robot)
    return spec


def _slide_to_start(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Shifts the bodies of sliding joints that follow a servo to their places in the initial posture."""
    slides = [(servo.index, one) for servo in robot.servos for one in servo.mimics if one.slides]
    if not slides:
        return
    assert robot.model is not None
    model, position, rotation = bare_model(robot.model), initial_position(robot), np.empty(9)
    for servo, one in slides:
        joint = model.joint(one.joint)
        body = model.body(int(joint.bodyid[0]))
        mujoco.mju_quat2Mat(rotation, body.quat)
        place = one.multiplier * position[servo] + one.offset - float(model.qpos0[joint.qposadr[0]])
        spec.body(body.name).pos = spec.body(body.name).pos + place * rotation.reshape(3, 3) @ joint.axis


def thick_pads(robot: Robot) -> tuple[Patch, ...]:
    """The patches whose thickness the model's own shapes lack."""
    return tuple(
        patch for patch in robot.patches if isinstance(patch.surface, Grid) and patch.surface.thickness
    )


def _add_pad(spec: mujoco.MjSpec, patch: Patch) -> None:
    pad = patch.surface
    assert isinstance(pad, Grid)
    pose = patch.mount @ pad.T_LP
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, pose[:3, :3].ravel())
    spec.body(patch.link).add_geom(
        name=f"tci_pad_{patch.name}",
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * pad.length, 0.5 * pad.width, 0.5 * pad.thickness],
        pos=pose[:3, 3] - 0.5 * pad.thickness * pose[:3, 2],
        quat=quaternion,
        mass=0.0,
        group=HIDDEN,
    )


def _set_self_collisions(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Sets MuJoCo's collision bits of each geom, so that the arms can collide with each other and with all
    other links. Geoms that do not collide according to the model file never collide."""
    arms = _arms(spec, robot)
    solid = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
    shown = [geom for geom in spec.geoms if not (geom.contype or geom.conaffinity)]
    # URDF models contain one geom that shows a mesh, and another geom for collisions of this mesh.
    meshes = {(geom.parent.name, geom.meshname) for geom in shown if geom.meshname}
    for geom in solid:
        if (geom.parent.name, geom.meshname) in meshes:
            geom.group = HIDDEN
        geom.contype, geom.conaffinity = _bits(*arms.get(geom.parent.name, (0, 0)))


def bits_of(spec: mujoco.MjSpec, robot: Robot) -> dict[str, tuple[int, int]]:
    """MuJoCo's `contype` and `conaffinity` of what belongs to each body of the model, as its links have
    them."""
    arms = _arms(spec, robot)
    return {body.name: _bits(*arms.get(body.name, (0, 0))) for body in spec.bodies}


def _bits(arm: int, distance: int) -> tuple[int, int]:
    if not arm:
        return 0, LEFT | RIGHT
    return (arm, RIGHT if arm == LEFT else LEFT) if distance > 1 else (0, 0)


def exclude_overlaps(spec: mujoco.MjSpec, robot: Robot, posture: Array) -> mujoco.MjModel:
    """Excludes pairs of bodies that overlap by construction, and compiles the model.

    The excluded pairs overlap at `posture` (n_servos,) [rad], or are near each other at `posture` and in most
    other postures. Raises DescriptionError if MuJoCo can't read a mesh, or if a joint is missing in the
    model.
    """
    assert robot.model is not None  # solid_spec raises an error for a robot without a model
    model = compiled(spec, robot.model)
    # people's hands wait at the origin, where the root of a robot may be, and touch that too
    hands = np.flatnonzero(model.body_contype & sum(HANDS)).tolist()
    pairs = [pair for pair in _overlapping(model, robot, posture) if not set(pair) & set(hands)]
    if not pairs:
        return model
    for first, second in pairs:
        spec.add_exclude(bodyname1=model.body(first).name, bodyname2=model.body(second).name)
    del model  # the compiled model of an iCub needs 50 MB
    return compiled(spec, robot.model)


def nearby(
    model: mujoco.MjModel, robot: Robot, posture: Array, *, within: float | None = None
) -> dict[tuple[int, int], float]:
    """Returns the pairs of bodies that are near each other at `posture` (n_servos,) [rad], and the least
    distance [m] of each pair.

    Bodies are given by their index in MuJoCo. A pair is near if its distance is below `within` [m]. If
    `within` is None, the margins of the model's geoms apply.
    """
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
    """Returns the pairs of bodies, as indices in MuJoCo, that are near each other by construction: they are
    in contact at `posture` (n_servos,) [rad], or near each other at `posture` and in nearly all random
    postures."""
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
    """Returns, by name, two numbers for each body of the model that an arm moves: the collision bit of the
    arm (LEFT or RIGHT), and the number of the arm's joints between the trunk and this body."""
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
