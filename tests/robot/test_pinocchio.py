"""Forward kinematics, Jacobians and gravity torques equal those of Pinocchio, which reads the exported
URDF."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from helpers.moving import ENDS, random_postures, robot_and_kinematics
from helpers.peers import needs_pinocchio
from tci.exports.urdf import TORSO, to_urdf
from tci.robot.gravity import STANDARD_GRAVITY, Gravity

pinocchio = needs_pinocchio()
COUNT = 1000


class Peer:
    """A robot in Pinocchio, loaded from the exported URDF."""

    def __init__(self, name: str) -> None:
        self.robot, _ = robot_and_kinematics(name)
        self.model = pinocchio.buildModelFromXML(to_urdf(self.robot))
        self.data = self.model.createData()
        self.torso = self.model.getFrameId(TORSO)
        joints = [(s.index, self.model.getJointId(s.joint)) for s in self.robot.servos if s.joint]
        self.servos = [servo for servo, _ in joints]
        self.columns = [self.model.joints[joint].idx_v for _, joint in joints]

    def move(self, posture: np.ndarray) -> None:
        q = np.zeros(self.model.nq)
        q[self.columns] = posture[self.servos]
        pinocchio.computeJointJacobians(self.model, self.data, q)
        pinocchio.updateFramePlacements(self.model, self.data)

    def pose(self, link: str) -> np.ndarray:
        """Returns the pose `T_TL` (4, 4) of a link in the torso."""
        T_WT = self.data.oMf[self.torso]
        return (T_WT.inverse() * self.data.oMf[self.model.getFrameId(link)]).homogeneous

    def jacobian(self, link: str) -> np.ndarray:
        """Returns the Jacobian (6, n_servos) of the link's origin, relative to the torso and in its frame."""
        world = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        frame = self.model.getFrameId(link)
        moved = pinocchio.getFrameJacobian(self.model, self.data, frame, world)
        torso = pinocchio.getFrameJacobian(self.model, self.data, self.torso, world)
        T_WT = self.data.oMf[self.torso]
        arm = self.data.oMf[frame].translation - T_WT.translation
        carried = torso.copy()
        carried[:3] += np.cross(torso[3:].T, arm).T
        relative = (moved - carried)[:, self.columns]
        result = np.zeros((6, len(self.robot.servos)))
        result[:3, self.servos] = T_WT.rotation.T @ relative[:3]
        result[3:, self.servos] = T_WT.rotation.T @ relative[3:]
        return result


@cache
def peer(name: str) -> Any:
    return Peer(name)


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_poses_and_jacobians_agree_on_1000_postures(name: str) -> None:
    robot, kinematics = robot_and_kinematics(name)
    links = [link for other, link in ENDS if other == name]
    pose_error = jacobian_error = 0.0
    for posture in random_postures(robot, COUNT, seed=8):
        peer(name).move(posture)
        for link in links:
            T_TL, jacobian = kinematics.pose_and_jacobian(posture, link)
            pose_error = max(pose_error, np.abs(T_TL - peer(name).pose(link)).max())
            jacobian_error = max(jacobian_error, np.abs(jacobian - peer(name).jacobian(link)).max())
    print(f"{name}: poses {pose_error:.0e}, Jacobians {jacobian_error:.0e}")
    assert pose_error <= 1e-9
    assert jacobian_error <= 1e-9


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_gravity_torques_agree(name: str) -> None:
    robot, _ = robot_and_kinematics(name)
    gravity, other = Gravity(robot), peer(name)
    for posture in random_postures(robot, 100, seed=9):
        other.move(posture)
        down = other.data.oMf[other.torso].rotation @ np.array([0.0, 0.0, -1.0])
        other.model.gravity.linear = STANDARD_GRAVITY * down
        q = np.zeros(other.model.nq)
        q[other.columns] = posture[other.servos]
        held = pinocchio.computeGeneralizedGravity(other.model, other.model.createData(), q)
        np.testing.assert_allclose(gravity.torques(posture)[other.servos], held[other.columns], atol=1e-9)
