"""The compiled bounds on distances are valid for MuJoCo's kinematics and distances."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from numba import njit

from helpers.robot_groups import two_armed
from tci.gate.kernels.clearance_bounds import at_least, stand, to_joints
from tci.gate.kernels.solids import Solids
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.clearance import Clearance
from tci.robot.description import GenericPart, GenericServo, Model, Robot, Servo

bound = njit(lambda shapes, points, frames, pairs, axis, p: at_least(shapes, points, frames, pairs, axis, p))


class Side:
    """The solids of a robot, and MuJoCo's model of the robot."""

    def __init__(self, name: str) -> None:
        self.robot = load_robot(name)
        self.clearance = Clearance(self.robot)
        s = self.solids = Solids.of(self.clearance)
        self.arrays = (s.path, s.steps, s.sums, s.shapes, s.points, s.poses, s.pairs, s.levers)
        self.data = mujoco.MjData(self.clearance.model)
        self.frames = np.zeros((len(s.steps), 3, 4))
        self.axis = np.zeros((len(s.pairs), 3))
        self.random = np.random.default_rng(2)
        self.lower = np.array([servo.limits.lower or 0.0 for servo in self.robot.servos])
        self.upper = np.array([servo.limits.upper or 0.0 for servo in self.robot.servos])

    def stand(self, position: Array) -> None:
        s = self.solids
        angles = position[s.servos] - s.zero
        stand(self.arrays, angles, self.frames, self.data.geom_xpos, self.data.geom_xmat, s.geoms)

    def measure(self, pair: int) -> tuple[float, Array]:
        """Returns the distance [m] between two geoms, and the vector from one to the other."""
        segment, (one, other) = np.zeros(6), self.clearance.pairs[pair].tolist()
        found = mujoco.mj_geomDistance(self.clearance.model, self.data, one, other, 10.0, segment)
        return found, segment[3:] - segment[:3]

    def bound(self, pair: int) -> float:
        s = self.solids
        return float(bound(s.shapes, s.points, self.frames, s.pairs, self.axis, pair))


@pytest.fixture(scope="module", params=(*two_armed(), "franka"))
def side(request: pytest.FixtureRequest) -> Side:
    return Side(request.param)


def test_geoms_are_where_mujoco_has_them(side: Side) -> None:
    model, geoms = side.clearance.model, side.solids.geoms
    other = mujoco.MjData(model)
    for _ in range(20):
        position = side.random.uniform(side.lower, side.upper)
        side.stand(position)
        for servo, joint in zip(side.clearance.servos, side.clearance.joints, strict=True):
            other.qpos[model.jnt_qposadr[joint]] = position[servo]
        mujoco.mj_kinematics(model, other)
        assert np.abs(side.data.geom_xpos[geoms] - other.geom_xpos[geoms]).max() < 1e-12
        assert np.abs(side.data.geom_xmat[geoms] - other.geom_xmat[geoms]).max() < 1e-12


def test_no_pair_is_nearer_than_its_bound_and_along_the_way_between_them_it_is_exact(side: Side) -> None:
    seen = 0
    for _ in range(8):
        side.stand(side.random.uniform(side.lower, side.upper))
        for pair in side.random.permutation(len(side.solids.pairs))[:40].tolist():
            side.axis[pair] = 0.0
            found, way = side.measure(pair)
            assert side.bound(pair) <= found + 1e-9
            guess = side.random.normal(size=3)
            side.axis[pair] = guess / np.linalg.norm(guess)
            assert side.bound(pair) <= found + 1e-9
            if found > 1e-3:
                side.axis[pair] = way / found
                assert found - 1e-6 < side.bound(pair) <= found + 1e-9
                seen += 1
    assert seen > 50


def test_no_joint_changes_a_distance_by_more_than_its_lever(side: Side) -> None:
    servos = side.solids.servos
    for _ in range(8):
        here = side.random.uniform(side.lower, side.upper)
        there = here + side.random.choice([1e-3, 0.05, 0.5]) * side.random.normal(size=here.shape)
        most = np.abs(there - here)[servos] @ side.solids.levers
        pairs = side.random.permutation(len(most))[:40].tolist()
        side.stand(here)
        before = [side.measure(pair)[0] for pair in pairs]
        side.stand(there)
        after = [side.measure(pair)[0] for pair in pairs]
        assert np.all(np.abs(np.subtract(after, before)) <= most[pairs] + 1e-5)


def test_joints_are_counted_from_their_zeros_in_the_models_order() -> None:
    ends = np.zeros((2, 2))
    to_joints(np.array([2, 0]), np.array([0.5, -1.0]), np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), ends)
    assert ends.tolist() == [[2.5, 2.0], [5.5, 5.0]]


OVAL = """
<mujoco><compiler angle="radian"/><worldbody><body name="torso"><geom type="box" size="0.1 0.1 0.3"/>
  <body name="upper" pos="0 0.3 0.2"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <joint name="pitch" axis="0 1 0"/><geom size="0.03"/>
    <body name="lower" pos="0 0 -0.2"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
      <joint name="yaw" axis="0 0 1"/><geom type="ellipsoid" size="0.02 0.12 0.15" pos="0 0 -0.1"/>
    </body>
  </body>
</body></worldbody></mujoco>
"""


def test_a_joint_through_the_middle_of_an_oval_shape_turns_it(tmp_path: Path) -> None:
    """The forearm is 20 mm thick in one direction and 120 mm in the other direction. Its centre lies on its
    yaw axis."""
    path = tmp_path / "oval.xml"
    path.write_text(OVAL)
    servos = [
        Servo(index=i, robot_part="arm", id=i, name=joint, joint=joint)
        for i, joint in enumerate(("pitch", "yaw"))
    ]
    joints = tuple(GenericServo(id=i, name=servo.name, servo=i) for i, servo in enumerate(servos))
    robot = Robot(
        name="oval", source="oval", digest=str(path), servos=tuple(servos),
        model=Model(format="mjcf", path=str(path), torso_link="torso"),
        parts=(GenericPart(name="left_arm", kind="arm", side="left", servos=joints),),
    )  # fmt: skip
    clearance = Clearance(robot)
    levers = Solids.of(clearance).levers[:, 0]
    near, far = (clearance.gaps(np.array([0.0, yaw]), within=1.0)[0] for yaw in (0.0, np.pi / 2))
    assert far - near == pytest.approx(0.1, abs=1e-3)
    assert levers[1] * np.pi / 2 > far - near
