"""Replays an impact with MuJoCo: the whole robot, coupled, with the servos that the prediction assumes."""

from __future__ import annotations

import numpy as np

from tci.lab.experiments.impacts import LASTING, Impact
from tci.robot.blow import REACTION
from tci.robot.collisions import solid_spec
from tci.robot.coupled_blow import Motors
from tci.robot.description import Robot
from tci.robot.kinematics import joints_of
from tci.support.engine import mujoco

STEP = 2e-4
"""[s]: a surface of `SURFACE` on 150 N/mm still swings over 18 steps."""
RADIUS = 0.05
"""Radius [m] of the region that is struck, an upper arm's: links slide off a small one."""
HARD = [2.0 * STEP, 1.0], [0.99, 0.99, 0.001, 0.5, 2.0], [0.5, 0.005, 1e-4]
"""MuJoCo's `solref`, `solimp` and `friction` of a contact that is much stiffer than people."""
SURFACE = 0.05
"""Mass [kg] of the surface of a region, on the region's spring."""


def replay(robot: Robot, impact: Impact, *, answered: bool = True) -> float:
    """Largest force [N] on the person."""
    spec = solid_spec(robot, mounted=False)
    spec.option.timestep, spec.option.gravity = STEP, [0.0, 0.0, 0.0]
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = int(geom.parent.name == impact.link), 0
        geom.solref, geom.solimp, geom.friction = HARD
    _person(spec, impact)
    model = spec.compile()
    data = mujoco.MjData(model)
    servos, addresses, columns = map(np.array, joints_of(robot, model))
    data.qpos[addresses] = impact.position[servos]
    mujoco.mj_forward(model, data)
    link, along = data.body(impact.link), impact.direction
    touch = link.xpos + link.xmat.reshape(3, 3) @ impact.point
    person = model.body("person").id
    model.body_pos[person] = touch + (RADIUS + 1e-4) * along
    mujoco.mju_quatZ2Vec(model.body_quat[person], along)
    motors = Motors(robot)
    model.dof_armature[columns] = motors.rotor[servos]
    stiffness, damping, most = (one[servos] for one in (motors.stiffness, motors.damping, motors.torque))
    mujoco.mj_setConst(model, mujoco.MjData(model))
    reference, goes = data.qpos[addresses].copy(), impact.velocity[servos]
    brakes, side = motors.acceleration[servos], np.sign(goes)
    data.qvel[columns] = goes
    spring = model.joint("person surface")
    bent, goes_in = spring.qposadr[0], spring.dofadr[0]
    reaction, largest = REACTION if answered else LASTING, 0.0
    for number in range(int(LASTING / STEP)):
        if number * STEP >= reaction:
            goes = side * np.maximum(side * goes - brakes * STEP, 0.0)
        reference += goes * STEP
        torque = stiffness * (reference - data.qpos[addresses]) + damping * (goes - data.qvel[columns])
        data.qfrc_applied[columns] = np.clip(torque, -most, most)
        mujoco.mj_step(model, data)
        force = impact.person.stiffness * data.qpos[bent] + model.dof_damping[goes_in] * data.qvel[goes_in]
        largest = max(largest, -float(force))
    return largest


def _person(spec: mujoco.MjSpec, impact: Impact) -> None:
    """Adds a sphere that gives way along z only: the region's mass, and on its spring the surface."""
    base = spec.worldbody.add_body(name="person", pos=[0.0, 0.0, -50.0])
    base.mass, base.inertia, base.explicitinertial = impact.person.mass, [1.0, 1.0, 1.0], True
    if not impact.clamped:
        base.add_joint(name="person", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, 1.0])
    surface = base.add_body(name="person surface")
    critical = 2.0 * float(np.sqrt(impact.person.stiffness * SURFACE))
    surface.add_joint(
        name="person surface", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 0.0, -1.0],
        stiffness=impact.person.stiffness, damping=0.3 * critical,
    )  # fmt: skip
    surface.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[RADIUS, 0.0, 0.0], mass=SURFACE, contype=2, conaffinity=1,
        solref=HARD[0], solimp=HARD[1], friction=HARD[2],
    )  # fmt: skip
