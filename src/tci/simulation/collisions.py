"""Which bodies of a robot collide: its arms with its trunk, and with each other.

Links beside a joint overlap by construction, so links of one arm do not collide with one another, and
the first link of an arm does not collide at all.
"""

from __future__ import annotations

import mujoco
import numpy as np

from tci.frames import Array
from tci.model.description import Robot

LEFT, RIGHT, SKIN = 1, 2, 4
"""Bits of MuJoCo's contype and conaffinity. The skin collides with the finger only."""

HIDDEN = 3
"""Group of geoms that pictures leave out."""


def set_self_collisions(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Give each geom of the model its bits; those that did not collide in the model never do."""
    for index, body in enumerate(spec.bodies):
        body.name = body.name or f"tci_body_{index}"
    arms = _arms(spec, robot)
    solid = [geom for geom in spec.geoms if geom.contype or geom.conaffinity]
    shown = [geom for geom in spec.geoms if not (geom.contype or geom.conaffinity)]
    # URDF models show a mesh by one geom and collide it by another.
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
    """Compile, after excluding pairs of bodies that overlap at `posture` (n_servos,) [rad]."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for servo in robot.servos:
        if servo.joint is not None:
            data.qpos[model.joint(servo.joint).qposadr] = posture[servo.index]
    mujoco.mj_forward(model, data)
    touching = model.geom_bodyid[data.contact.geom[: data.ncon]]
    pairs = {(int(low), int(high)) for low, high in np.sort(touching, axis=1)}
    for first, second in sorted(pairs):
        spec.add_exclude(bodyname1=model.body(first).name, bodyname2=model.body(second).name)
    return spec.compile() if pairs else model


def _arms(spec: mujoco.MjSpec, robot: Robot) -> dict[str, tuple[int, int]]:
    """Of each body that an arm's joints move: the arm's bit, and how many of its joints lie before it."""
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
