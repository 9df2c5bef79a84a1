"""Notes on parts (head, torso, legs) that are in a model but not in its proposed description, with
reasons."""

from __future__ import annotations

import numpy as np

from tci.lab.authoring.find_legs import ALIKE, SLANTED, find_legs
from tci.lab.authoring.find_limbs import extent_of
from tci.lab.authoring.joint_tree import read_joints
from tci.lab.authoring.limb_kind import is_named_as
from tci.robot.description import Robot
from tci.robot.kinematics import bare_model
from tci.robot.model_file import world_of
from tci.support.engine import mujoco

STEEPEST = 0.26
"""Least cosine between the axis of hip pitch and the y axis at which joints that fit no generic leg are still
reported as legs. Assumed: the axis of hip pitch is at most 75 degrees from the y axis."""

SLIDES = int(mujoco.mjtJoint.mjJNT_SLIDE)


def left_out(robot: Robot) -> list[str]:
    """Returns notes on what a proposed description does not use.

    One note lists the world around the robot in an MJCF, one the sliding joints. Another note follows for
    each kind of part (head, torso, legs) that is left out although places or names of joints suggest such a
    part.
    """
    if robot.model is None:
        return []
    model = bare_model(robot.model)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    R_RT = data.xmat[model.body(robot.model.torso_link).id].reshape(3, 3) @ robot.model.T_LT[:3, :3]
    joints = read_joints(model, data, R_RT)
    servos = [one.servo for part in robot.parts for one in part.servos if one.servo is not None]
    mapped = {robot.servos[servo].joint for servo in servos}
    taken = {place for place, joint in enumerate(joints) if joint.name in mapped}
    kinds = {part.kind for part in robot.parts if any(one.servo is not None for one in part.servos)}
    driven = {one.joint for servo in robot.servos for one in servo.joints}
    sliding = [
        one.name for one in map(model.joint, range(model.njnt))
        if one.type[0] == SLIDES and one.name not in driven
    ]  # fmt: skip
    told = f"{', '.join(sliding)}: no generic joint slides; at the model's zero in simulation"
    notes = [told] if sliding else []
    if world := world_of(robot.model):
        notes.insert(0, f"{', '.join(world)}: the model's world, no part of the robot; left out")
    if "leg" not in kinds and (legs := find_legs(joints, taken, extent_of(joints), slanted=STEEPEST)):
        hips = [joints[leg.hip] for leg in legs.values()]
        slants = [np.rad2deg(np.arccos(min(1.0, abs(float(hip.axis[1]))))) for hip in hips]
        steep = (
            f"no legs: {' and '.join(hip.name for hip in hips)} are slanted by {max(slants):.0f} degrees "
            f"against the left-right axis; valid: at most {np.rad2deg(np.arccos(SLANTED)):.0f}"
        )
        return [*notes, steep]
    angle = np.rad2deg(np.arccos(ALIKE))
    reasons = {
        "leg": "form no pair of legs that bend at hip, knee and ankle",
        "head": f"turn about no axis of the torso, to {angle:.0f} degrees, in one chain above the shoulders",
        "torso": f"turn about no axis of the torso, to {angle:.0f} degrees, between the base and both arms",
    }
    for kind, reason in reasons.items():
        free = [joint.name for place, joint in enumerate(joints) if place not in taken]
        own = [name for name in free if kind not in kinds and is_named_as(kind, name)]
        if own:
            notes.append(f"no {kind}: {', '.join(own)}; they {reason}")
    return notes
