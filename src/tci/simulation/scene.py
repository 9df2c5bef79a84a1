"""Builds the MuJoCo scene of a world from a robot's description alone.

The module contains no code for a particular robot.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from functools import lru_cache
from typing import Any

import numpy as np

from tci.errors import CommandError
from tci.messages.frames import Array, apply, invert, transform
from tci.robot.collisions import ALL_PEOPLE, GROUND, HANDS, bits_of, exclude_overlaps, solid_spec
from tci.robot.description import SOLE, Robot
from tci.robot.kinematics import KinematicChain, written
from tci.robot.neutral import neutral, plain_options
from tci.simulation.finger import RADIUS, add_finger
from tci.simulation.hand_model import PersonModel, add_hand
from tci.simulation.obstacle import Obstacle, add_obstacle
from tci.simulation.touch import FINGER_PRIORITY, FLOOR, add_skin
from tci.simulation.touch import FRICTION as SLIDES
from tci.skin.surfaces import Surface
from tci.support.engine import mujoco

FRICTION = [0.8, 0.005, 0.0001]
"""Friction of the floor: sliding, spinning [m], rolling [m]. Assumed: rubber on wood."""


def build_scene(
    robot: Robot,
    surfaces: Mapping[str, Surface],
    posture: Array,
    *,
    step: float,
    stands: bool = False,
    shown: bool = False,
    tip: float = RADIUS,
    hands: Mapping[str, PersonModel] | None = None,
    obstacles: Sequence[Obstacle] = (),
    self_touch: bool = False,
    weight: bool = False,
) -> mujoco.MjModel:
    """Builds and compiles a model of the robot with its servos and skin, and of a finger.

    With `shown` the model also contains geometry that only pictures need. Bodies and joints are equal with
    and without `shown`.

    Links that overlap in `posture` (n_servos,) [rad] are assumed to overlap by design, and never collide. The
    robot's base is fixed, and the robot has no weight. With `stands` the robot has a weight and stands in
    `posture` on a floor. Raises DescriptionError if the robot has no model. Raises CommandError if the robot
    is to stand and has no sole with skin.
    """
    settings: dict[str, Any] = {"step": step, "stands": stands, "tip": tip}
    settings |= {"self_touch": self_touch, "weight": weight}
    if shown or hands or obstacles or robot.model is None:
        return _built(robot, surfaces, posture, shown=shown, hands=hands, obstacles=obstacles, **settings)
    key = tuple(surfaces.values()), tuple(posture.tolist()), written(robot.model)
    return copy(_alone(robot, *key, **settings))


@lru_cache(maxsize=8)
def _alone(
    robot: Robot,
    surfaces: tuple[Surface, ...],
    posture: tuple[float, ...],
    _: tuple[int, ...],
    **settings: Any,
) -> mujoco.MjModel:
    """A scene without people, of which the next world gets a copy: to build it takes twenty times as long.
    The fourth argument has the times [ns] at which the model's files were last written."""
    return _built(robot, {one.patch: one for one in surfaces}, np.array(posture), **settings)


def _built(
    robot: Robot,
    surfaces: Mapping[str, Surface],
    posture: Array,
    *,
    step: float,
    stands: bool,
    tip: float,
    self_touch: bool,
    weight: bool,
    shown: bool = False,
    hands: Mapping[str, PersonModel] | None = None,
    obstacles: Sequence[Obstacle] = (),
) -> mujoco.MjModel:
    spec = solid_spec(robot, shown=shown)
    plain_options(spec)
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _add_servos(spec, robot)
    if weight and not stands:
        for body in spec.bodies[1:]:
            body.gravcomp = 1.0
    elif not stands:
        # The integral action of a real servo compensates the weight after some time. The simulated servos
        # have no integral action, so gravity is left out. Then the servos keep a posture exactly, from the
        # start.
        spec.option.gravity = np.zeros(3)
    bits = bits_of(spec, robot) if self_touch else {}
    if self_touch:
        for geom in spec.geoms:
            geom.friction = [SLIDES, 0.005, 1e-4]
    for patch in robot.patches:
        if patch.name in surfaces:
            add_skin(
                spec,
                surfaces[patch.name],
                axes=patch.sensor.axes,
                step=step,
                floor=stands and patch.segment == SOLE,
                own=bits.get(surfaces[patch.name].link),
            )
    add_finger(spec, step=step, radius=tip)
    if hands and not stands:
        # a tenth faster with the few contacts of hands, and forces are equal within 0.2 mN; a robot that
        # stands has more contacts, for which Newton's method is better
        spec.option.solver = mujoco.mjtSolver.mjSOL_CG
    if hands or obstacles:
        for geom in spec.geoms:
            if geom.contype or geom.conaffinity or not shown:
                geom.conaffinity |= ALL_PEOPLE
        for (name, person), bit in zip((hands or {}).items(), HANDS, strict=False):
            add_hand(spec, name, person, step=step, bit=bit)
        for obstacle in obstacles:
            add_obstacle(spec, obstacle, step=step)
    if shown:
        spec.add_texture(
            name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.85, 0.9, 0.95], rgb2=[0.6, 0.6, 0.58], width=64, height=64,
        )  # fmt: skip
    if stands:
        _add_floor(spec, robot, surfaces, posture)
    return exclude_overlaps(spec, robot, posture)


def _add_floor(spec: mujoco.MjSpec, robot: Robot, surfaces: Mapping[str, Surface], posture: Array) -> None:
    """Adds a floor under the lowest taxel of the soles in `posture` (n_servos,) [rad].

    Also adds a free joint to the base, so that the robot may fall.
    """
    soles = [
        surfaces[patch.name] for patch in robot.patches if patch.segment == SOLE and patch.name in surfaces
    ]
    if not soles:
        raise CommandError(
            f"{robot.name} can't stand: no skin on a segment {SOLE!r}, so nothing senses its weight"
        )
    base = spec.worldbody.first_body()
    poses = KinematicChain(robot).poses(posture, [base.name, *(sole.link for sole in soles)])
    R_WB = np.empty(9)
    mujoco.mju_quat2Mat(R_WB, base.quat)
    T_WT = transform(R_WB.reshape(3, 3), base.pos) @ invert(poses[base.name])
    lowest = min(float(apply(T_WT @ poses[sole.link], sole.positions)[:, 2].min()) for sole in soles)
    spec.worldbody.add_geom(
        neutral(spec), name=FLOOR, type=mujoco.mjtGeom.mjGEOM_PLANE, size=[2.0, 2.0, 0.1],
        pos=[0.0, 0.0, lowest], contype=GROUND, conaffinity=0, condim=3, friction=FRICTION,
        priority=FINGER_PRIORITY + 2, rgba=[0.8, 0.8, 0.78, 1.0],
    )  # fmt: skip
    base.add_freejoint()


def _add_servos(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Adds a position actuator with the description's limits for each servo.

    `Servos` sets the gains of the actuators.
    """
    # Before a specification is compiled, its angles have the unit of its file.
    unit = np.rad2deg(1.0) if spec.compiler.degree else 1.0
    for servo in robot.servos:
        limits = servo.limits
        for one in servo.joints:
            joint = spec.joint(one.joint)
            lever = abs(one.multiplier) if one.slides else 1.0
            if limits.torque is not None and joint.frictionloss * lever >= limits.torque:
                # Against such a friction no motion is possible, so it can't be meant; tci check tells it.
                joint.frictionloss, joint.damping = 0.0, np.zeros(3)
            if limits.lower is not None and limits.upper is not None:
                joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
                ends = np.array([limits.lower, limits.upper]) * one.multiplier + one.offset
                joint.range = np.sort(ends) * (1.0 if one.slides else unit)
            joint.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE
            actuator = spec.add_actuator(
                neutral(spec), name=one.joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=one.joint
            )
            actuator.set_to_position(kp=1.0, kv=1.0)
            actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
            actuator.forcerange = np.array([-1.0, 1.0])
