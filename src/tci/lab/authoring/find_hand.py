"""Finds a hand that is alone, held by a stand: fingers side by side on one link, and nothing that carries
them."""

from __future__ import annotations

import numpy as np

from tci.lab.authoring.find_fingers import FEWEST
from tci.lab.authoring.find_limbs import FoundLimbs, extent_of
from tci.lab.authoring.joint_tree import carried, read_joints
from tci.robot.description import Model
from tci.robot.generic_arm import Side
from tci.robot.kinematics import bare_model
from tci.support.engine import mujoco

LARGEST = 0.35
"""Largest extent [m] of all joints of a hand. Assumed: twice that of a human hand, less than that of robots
with legs, whose limbs are side by side on one link too."""


def find_hand(model: Model, side: Side) -> FoundLimbs | None:
    """The hand in a model that has nothing else; None if it is no hand. The torso frame is the model's root
    frame, at the link that carries most fingers. Which chain is which finger is decided later."""
    compiled = bare_model(model)
    data = mujoco.MjData(compiled)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(compiled, data)
    joints = read_joints(compiled, data, np.eye(3))
    if not joints or extent_of(joints) > LARGEST:
        return None
    bases = [joint.parent for index, joint in enumerate(joints) if len(carried(joints, index)) > 1]
    if max(map(bases.count, bases), default=0) < FEWEST:
        return None
    first = next(joint for joint in joints if joint.parent < 0)
    palm = int(compiled.body_parentid[compiled.body(first.link).id])
    if not palm:
        return None
    pose = np.eye(4)
    pose[:3, :3] = data.xmat[palm].reshape(3, 3).T
    return FoundLimbs(
        joints=joints, arms={}, legs={}, torso_link=compiled.body(palm).name, trunk=(), trunk_below=False,
        head=(), devices=(), R_RH=np.eye(3), T_ET=pose, hand=side,
    )  # fmt: skip
