"""The packaged arms on a wall and a ceiling, with a side and a direction of forward by choice, judged by
Pinocchio on the maker's file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from helpers.peers import needs_pinocchio
from tci.exports.denavit_hartenberg import denavit_hartenberg
from tci.lab.authoring.proposal import propose
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.description import Mount, Robot
from tci.robot.generic_arm import Side
from tci.robot.gravity import STANDARD_GRAVITY, Gravity
from tci.robot.inverse import InverseKinematics
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain

pinocchio = needs_pinocchio()
CASES: list[tuple[str, Mount, Side, str, str]] = [
    ("franka", "wall", "right", "x", "panda_link5"),
    ("ur5", "ceiling", "left", "y", "wrist_1_link"),
    ("so101", "wall", "left", "-y", "wrist_link"),
]
"""Arm, mount, side, forward, and the link of the wrist."""
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "-y": (0.0, -1.0, 0.0)}
ROUNDED = 1e-5
"""Models are rounded: so101's pan leans by 2e-6."""


class File:
    """An arm as Pinocchio reads the maker's file. On it, the pan of these arms is the base's z axis."""

    def __init__(self, robot: Robot, mount: Mount, forward: str) -> None:
        assert robot.model is not None
        self.robot, self.base = robot, robot.model.torso_link
        self.model: Any = pinocchio.buildModelFromUrdf(robot.model.path)
        self.data = self.model.createData()
        pan, ahead = np.eye(3)[2], np.array(AXES[forward])
        x, z = {"table": (ahead, pan), "ceiling": (ahead, -pan), "wall": (pan, ahead)}[mount]
        self.R_BT = np.column_stack([x, np.cross(z, x), z])

    def _move(self, position: Array) -> Array:
        q = pinocchio.neutral(self.model)
        for servo in self.robot.servos:
            q[self.model.joints[self.model.getJointId(servo.joint)].idx_q] = position[servo.index]
        pinocchio.framesForwardKinematics(self.model, self.data, q)
        return q

    def pose(self, position: Array, link: str) -> Array:
        """Pose `T_TL` (4, 4) of a link."""
        self._move(position)
        base, there = (self.data.oMf[self.model.getFrameId(name)] for name in (self.base, link))
        pose = (base.inverse() * there).homogeneous
        return np.vstack([self.R_BT.T @ pose[:3], pose[3:]])

    def weights(self, position: Array) -> Array:
        """Torques (n_servos,) [N m] that hold the arm, with the torso frame upright."""
        q = self._move(position)
        rotation = self.data.oMf[self.model.getFrameId(self.base)].rotation @ self.R_BT
        self.model.gravity.linear = rotation @ [0.0, 0.0, -STANDARD_GRAVITY]
        torques = pinocchio.computeGeneralizedGravity(self.model, self.data, q)
        columns = [self.model.joints[self.model.getJointId(one.joint)].idx_v for one in self.robot.servos]
        return np.array(torques[columns])


@pytest.mark.parametrize(("name", "mount", "side", "forward", "wrist"), CASES)
def test_a_mounted_arm_is_that_of_its_file(
    name: str, mount: Mount, side: Side, forward: str, wrist: str
) -> None:
    """Poses, DH tables, weights, inverse kinematics; and pitch turns it to its inner side, roll away from
    what carries it."""
    packaged = load_robot(name)
    assert packaged.model is not None
    robot = propose(
        Path(packaged.model.path), name=name, side=side, mount=mount, forward=forward, trust_fingers="none",
        package=packaged.model.package,
    )  # fmt: skip
    file, chain, random = File(robot, mount, forward), KinematicChain(robot), np.random.default_rng(1)
    limits = np.array([(one.limits.lower, one.limits.upper) for one in robot.servos], dtype=float).T
    tables = [denavit_hartenberg(chain, wrist, convention=one) for one in ("classic", "modified")]
    inverse, start = InverseKinematics(robot, chain, wrist), initial_position(robot)
    for position in random.uniform(*limits, (30, len(robot.servos))):
        there = file.pose(position, wrist)
        np.testing.assert_allclose(chain.poses(position, [wrist])[wrist], there, atol=ROUNDED)
        for table in tables:
            np.testing.assert_allclose(table.pose(position), there, atol=ROUNDED)
        np.testing.assert_allclose(Gravity(robot).torques(position), file.weights(position), atol=1e-3)
        answer = inverse.solve(there[:3, 3], start)
        assert answer.reached
        np.testing.assert_allclose(file.pose(answer.position, wrist)[:3, 3], there[:3, 3], atol=2e-5)
    joints, part = joint_map(robot, f"{side}_arm"), robot.part(f"{side}_arm")
    outward = np.eye(3)[0] if mount == "wall" else -np.eye(3)[2]
    ahead = np.eye(3)[2] if mount == "wall" else np.eye(3)[0]

    def rotation(posture: Array) -> Array:
        position = np.array(start)
        position[joints.servos] = joints.to_robot(posture, position)
        return file.pose(position, wrist)[:3, :3]

    for pitch, turn, axis in (
        (0.2, [0.3, 0.0, 0.0, 0.0, 0.0], outward * (1.0 if side == "right" else -1.0)),
        (0.0, [0.0, 0.3, 0.0, 0.0, 0.0], np.cross(ahead, outward)),
    ):
        begun = part.initial_posture + np.array([pitch, 0.0, 0.0, 0.0, 0.0])
        turned = rotation(begun + np.array(turn)) @ rotation(begun).T
        np.testing.assert_allclose(pinocchio.log3(turned), 0.3 * axis, atol=ROUNDED)
