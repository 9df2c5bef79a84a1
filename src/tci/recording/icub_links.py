"""Frames of iCub's links as iDyn numbers them, in which skinManager gives contacts.

iDyn attaches a frame to each link by the rule of Denavit and Hartenberg: z along the axis of the next joint,
x along the common normal of the two axes. The frames of a URDF's links lie elsewhere: on a forearm 107 mm
away, and turned by more than 90 degrees. So the frames are computed from the joints' axes in the model.
"""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.kinematics import bare_model
from tci.robot.shoulder import nearest_point
from tci.support.engine import mujoco

AXES = {"upper_arm": ("shoulder_yaw", "elbow", -1.0), "forearm": ("wrist_prosup", "wrist_pitch", 1.0)}
"""Joints before and after a link, and the sign of the link's alpha (90 degrees) in iKin's parameters of both
arms (icub-main 2.11.1, `iCubArm`)."""
ENDS = {"hand": "hand_dh_frame", "thigh": "upper_leg_dh_frame", "foot": "foot_dh_frame"}
"""Links of the makers' models that are such frames, where no next joint shows it."""


def has_icub_joints(robot: Robot) -> bool:
    """True if the joints have the names of an iCub's arms, so that iDyn's frames are those of this robot."""
    names = {servo.joint for servo in robot.servos}
    return {f"{side}_{joint}" for side in "lr" for pair in AXES.values() for joint in pair[:2]} <= names


def link_frame(robot: Robot, patch: str) -> Array | None:
    """The pose `T_LD` (4, 4) [m], in the frame L of a patch's link, of the frame D that iDyn attaches to this
    link. None if the robot has not iCub's joints, or if the frame is unknown: on the torso and the shanks."""
    worn = robot.patch(patch)
    side = "l_" if worn.part.startswith("left") else "r_" if worn.part.startswith("right") else ""
    segment = worn.segment or ("hand" if worn.part.endswith("hand") else "")
    if robot.model is None or not side or not has_icub_joints(robot):
        return None
    model = bare_model(robot.model)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    links = {model.body(k).name for k in range(model.nbody)}
    if segment in AXES:
        before, after, sign = AXES[segment]
        pose = _common_normal(data.joint(side + before), data.joint(side + after), sign)
    elif (side + ENDS.get(segment, "")) in links:
        pose = _pose(data.body(side + ENDS[segment]))
    else:
        return None
    return read_only(np.linalg.inv(_pose(data.body(worn.link))) @ pose)


def _common_normal(before: mujoco.MjDataJoint, after: mujoco.MjDataJoint, sign: float) -> Array:
    x = sign * np.cross(before.xaxis, after.xaxis)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(after.xaxis, x), after.xaxis])
    pose[:3, 3] = nearest_point(after.xanchor, before.xanchor, after.xaxis, before.xaxis)
    return pose


def _pose(body: mujoco.MjDataBody) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = body.xmat.reshape(3, 3), body.xpos
    return pose
