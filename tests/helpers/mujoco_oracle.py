"""Kinematics computed by MuJoCo. The compiled loops must give equal results."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco
import numpy as np

from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import bare_model


class Oracle:
    """Poses, Jacobians and centre of mass of one robot, computed with a separate MuJoCo data object."""

    def __init__(self, robot: Robot) -> None:
        assert robot.model is not None
        self.model, self.robot = bare_model(robot.model), robot
        self.data = mujoco.MjData(self.model)
        driven = [(servo.index, one) for servo in robot.servos for one in servo.joints]
        self.servos = [servo for servo, _ in driven]
        joints = [self.model.joint(one.joint) for _, one in driven]
        self.addresses = [int(joint.qposadr[0]) for joint in joints]
        self.columns = [int(joint.dofadr[0]) for joint in joints]
        self.ratio, self.shift = np.array([(one.multiplier, one.offset) for _, one in driven]).T
        self.T_LT = robot.model.T_LT
        self.torso = self.model.body(robot.model.torso_link).id

    def move(self, position: Array) -> Array:
        """Moves to `position` (n_servos,) [rad]. Returns the pose `T_WT` (4, 4) of the torso in the world."""
        self.data.qpos[self.addresses] = position[self.servos] * self.ratio + self.shift
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        return self.pose_of(self.torso) @ self.T_LT

    def pose_of(self, body: int) -> Array:
        """Returns the pose `T_WL` (4, 4) of a link in the world."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.data.xmat[body].reshape(3, 3), self.data.xpos[body]
        return pose

    def poses(self, position: Array, links: Iterable[str]) -> dict[str, Array]:
        T_TW = np.linalg.inv(self.move(position))
        return {link: T_TW @ self.pose_of(self.model.body(link).id) for link in links}

    def jacobian(self, position: Array, link: str, point: Array) -> Array:
        """Returns the Jacobian (6, n_servos) of a point of a link, relative to the torso and in its frame."""
        T_WT, body = self.move(position), self.model.body(link).id
        p_W = (self.pose_of(body) @ np.append(point, 1.0))[:3]
        moved, carried = np.zeros((2, 6, self.model.nv))
        mujoco.mj_jac(self.model, self.data, moved[:3], moved[3:], p_W, body)
        mujoco.mj_jac(self.model, self.data, carried[:3], carried[3:], p_W, self.torso)
        relative = (moved - carried)[:, self.columns] * self.ratio
        relative = np.concatenate([T_WT[:3, :3].T @ relative[:3], T_WT[:3, :3].T @ relative[3:]])
        result = np.zeros((6, len(self.robot.servos)))
        np.add.at(result.T, self.servos, relative.T)
        return result


def posed(robot: Robot, part: str, posture: Array) -> mujoco.MjData:
    """MuJoCo's data with a part at generic angles `posture` (n,) [rad], and all others at the start."""
    oracle, joints, position = Oracle(robot), joint_map(robot, part), np.array(initial_position(robot))
    position[joints.servos] = joints.to_robot(posture, position)
    oracle.move(position)
    return oracle.data
