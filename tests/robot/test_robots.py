"""Properties that every packaged robot with two arms must have."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import mujoco
import numpy as np
import pytest
from lxml import etree

from helpers.robot_groups import two_armed
from tci.body.posture import to_platform
from tci.body.retarget import with_retargeting
from tci.exports.cone import cone_of
from tci.messages import GenericCommand, Mode
from tci.messages.frames import Array, angle_between
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.generic_arm import JOINTS, Side, forearm_rotation, side_sign, upper_arm_rotation
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.model_file import load_spec
from tci.robot.xml import schema_path
from tci.robot.xml.extends import read_element
from tci.skin.surfaces import build_surface

COMMON_RANGE = np.deg2rad([[-10, 95.5], [0, 76], [-29.5, 65], [15, 88.5], [-60, 60]])
SIDES = ("left", "right")
HUMANOIDS = two_armed()
LACKING = {"nao-h21": ["elbow_yaw"], "nao-plain-h21": ["elbow_yaw"]}
"""Generic joints that the arms of some robots lack."""
BARE = ("nao-plain", "nao-plain-h21", "g1-inspire")
"""Robots without skin on their arms."""


@pytest.fixture(scope="module", params=HUMANOIDS)
def robot(request: pytest.FixtureRequest) -> Robot:
    return load_robot(request.param)


class ModelArm:
    """One arm of a robot, read directly from the MuJoCo model."""

    def __init__(self, robot: Robot, side: Side) -> None:
        assert robot.model is not None
        self.robot, self.part = robot, robot.part(f"{side}_arm")
        self.model = load_spec(robot.model).compile()
        self.data = mujoco.MjData(self.model)
        self.torso = self.model.body(robot.model.torso_link).id

    def at(self, posture: Array) -> None:
        """Moves to generic angles (5,) [rad]."""
        command = to_platform(self.robot, GenericCommand(self.part.name, Mode.POSITION, posture))
        for index, angle in zip(command.servos, command.values, strict=True):
            self.data.qpos[self.model.joint(self.robot.servos[index].joint).qposadr] = angle
        mujoco.mj_kinematics(self.model, self.data)

    @property
    def R_MW(self) -> Array:
        """Rotation (3, 3) from world frame to the mount frame of the arm."""
        assert self.robot.model is not None
        R_WT = self.data.xmat[self.torso].reshape(3, 3) @ self.robot.model.T_LT[:3, :3]
        result: Array = self.part.R_TM.T @ R_WT.T
        return result

    def joint(self, generic: int) -> int:
        """Returns MuJoCo's index of the joint that a generic joint is mapped to."""
        servo = self.part.servos[generic].servo
        assert servo is not None
        return int(self.model.joint(self.robot.servos[servo].joint).id)

    def axis(self, generic: int) -> Array:
        """Returns the axis (3,) of a generic joint in the mount frame, pointing in the positive direction of
        rotation."""
        sign = np.sign(self.part.servos[generic].scale)
        result: Array = self.R_MW @ self.data.xaxis[self.joint(generic)] * sign
        return result

    def along(self) -> Array:
        """Returns the axis (3,) of internal rotation in the mount frame, pointing towards the elbow."""
        first, second = self.joint(2), self.joint(3)
        axis = self.data.xaxis[first]
        way = self.data.xanchor[second] - self.data.xanchor[first]
        result: Array = self.R_MW @ axis * np.sign(axis @ way)
        return result

    def hand(self) -> Array:
        """Returns the orientation (3, 3), in the mount frame, of the link that the pronation joint moves."""
        body = self.model.jnt_bodyid[self.joint(4)]
        result: Array = self.R_MW @ self.data.xmat[body].reshape(3, 3)
        return result


@pytest.mark.parametrize("side", SIDES)
def test_axes_of_nao_and_icub_agree_in_their_mount_frames(side: Side) -> None:
    """In 300 postures, the axes of upper arm and forearm and the direction of the thumb agree within 0.01
    degrees."""
    sign = side_sign(side)
    arms = [ModelArm(load_robot(name), side) for name in ("nao", "icub")]
    thumbs_H = []
    for arm in arms:
        arm.at(np.zeros(5))
        thumbs_H.append(arm.hand().T[:, 0])  # at the generic zero, the thumb points forward
    worst = 0.0
    for posture in np.random.default_rng(2).uniform(*COMMON_RANGE.T, size=(1000, 5)):
        # Internal rotation turns about the upper arm and pronation about the forearm.
        ideal = [
            -sign * upper_arm_rotation(posture, side, axial=False)[:, 2],
            -sign * forearm_rotation(posture, side, axial=False)[:, 2],
            forearm_rotation(posture, side, axial=True)[:, 0],
        ]
        seen = []
        for arm, thumb_H in zip(arms, thumbs_H, strict=True):
            arm.at(posture)
            seen.append([arm.axis(2), arm.axis(4), arm.hand() @ thumb_H])
        pairs = [
            *zip(*seen, strict=True),
            *zip(seen[0], ideal, strict=True),
            *zip(seen[1], ideal, strict=True),
        ]
        worst = max(worst, *(float(np.rad2deg(angle_between(a, b))) for a, b in pairs))
    print(f"{side}: NAO, iCub and the generic arm differ by at most {worst:.1e} degrees")
    assert worst <= 0.01


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("name", HUMANOIDS)
def test_axes_agree_with_the_generic_arm_in_the_torso_frame(name: str, side: Side) -> None:
    """In 1000 postures, the axes of upper arm and forearm agree within 0.5 degrees if the limits permit."""
    robot = load_robot(name)
    part = f"{side}_arm"
    if any(robot.part(part).mount):
        robot = with_retargeting(robot, part)
    arm = ModelArm(robot, side)
    sign = side_sign(side)
    worst, tried = 0.0, 0
    for posture in np.random.default_rng(2).uniform(*COMMON_RANGE.T, size=(300, 5)):
        command = to_platform(robot, GenericCommand(part, Mode.POSITION, posture))
        limits = [robot.servos[servo].limits for servo in command.servos]
        lower, upper = np.array([[limit.lower, limit.upper] for limit in limits], dtype=float).T
        if np.any(command.values < lower) or np.any(command.values > upper):
            continue
        tried += 1
        arm.at(posture)
        pairs = [
            (arm.along(), -upper_arm_rotation(posture, side, axial=False)[:, 2]),
            (arm.axis(3), -upper_arm_rotation(posture, side, axial=True)[:, 1]),
        ]
        if robot.part(part).servos[4].servo is not None:  # the NAO H21 has no wrist
            pairs.append((arm.axis(4) * sign, -forearm_rotation(posture, side, axial=False)[:, 2]))
        worst = max(worst, *(float(np.rad2deg(angle_between(a, b))) for a, b in pairs))
    print(f"{name}, {side}: {tried} of 300 postures within limits, at most {worst:.1e} degrees off")
    assert tried >= 150
    assert worst <= 0.5


def test_initial_posture_is_inside_and_away_from_limits(robot: Robot) -> None:
    for part in robot.parts:
        if part.kind != "arm":
            continue
        assert [servo.name for servo in part.servos] == list(JOINTS)
        assert [servo.name for servo in part.servos if servo.servo is None] == LACKING.get(robot.name, [])
        for generic in part.servos:
            if generic.servo is None:
                continue
            limits = robot.servos[generic.servo].limits
            assert limits.lower is not None
            assert limits.upper is not None
            angle = initial_position(robot)[generic.servo]
            assert limits.lower + 0.05 < angle < limits.upper - 0.05


def test_couplings_hold_in_the_initial_posture(robot: Robot) -> None:
    for coupling in robot.couplings:
        value = initial_position(robot)[list(coupling.servos)] @ np.array(coupling.coefficients)
        assert coupling.lower < value < coupling.upper


def test_mapped_servos_can_be_moved(robot: Robot) -> None:
    mapped = {generic.servo for part in robot.parts for generic in part.servos if generic.servo is not None}
    for index in mapped:
        servo = robot.servos[index]
        figures = servo.limits.model_dump(exclude={"assumed"})
        assert None not in figures.values(), servo.name
        assert {"acceleration", "jerk"} <= set(servo.limits.assumed), "nobody publishes these"


def test_left_and_right_mirror_each_other(robot: Robot) -> None:
    left, right = (robot.part(f"{side}_arm") for side in SIDES)
    for a, b in zip(left.servos, right.servos, strict=True):
        assert a.transform == b.transform
        if a.transform == "retarget":
            continue  # the limits of a shoulder restrict all three joints together
        assert (a.servo is None) == (b.servo is None)
        if a.servo is None:
            continue
        ranges = []
        for generic in (a, b):
            limits = robot.servos[generic.servo].limits
            assert limits.lower is not None
            assert limits.upper is not None
            ends = generic.scale * np.array([limits.lower, limits.upper]) + generic.offset
            ranges.append(sorted(ends))
        np.testing.assert_allclose(*ranges, atol=1e-6)


def test_skin_lies_on_its_segment(robot: Robot) -> None:
    kinematics = KinematicChain(robot)
    patches = [patch for patch in robot.patches if robot.limb_segment(patch)]
    sleeves = set(product(("left_arm", "right_arm"), ("upper_arm", "forearm")))
    assert {(patch.part, patch.segment) for patch in patches} == (set() if robot.name in BARE else sleeves)
    for patch in patches:
        surface = build_surface(robot, patch, kinematics)
        assert len(set(surface.channels.tolist())) == len(surface.positions)
        fit = cone_of(robot, surface, kinematics)
        assert 0.02 < fit.r1 < 0.085  # an adult's size: Talos
        assert fit.rms < 0.006
        assert fit.largest < 0.015


def test_the_schema_accepts_the_description(robot: Robot) -> None:
    schema = etree.XMLSchema(etree.parse(str(schema_path())))
    schema.assertValid(read_element(Path(robot.source))[0])


def test_head_and_torso_turn_as_their_convention_says(robot: Robot) -> None:
    """Pitch is positive about the torso's y axis, roll about x, yaw about z, for all signs of the robot's
    servos."""
    assert robot.model is not None
    model = load_spec(robot.model).compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    R_WT = data.xmat[model.body(robot.model.torso_link).id].reshape(3, 3) @ robot.model.T_LT[:3, :3]
    for name in ("head", "torso"):
        for generic, wanted in zip(robot.part(name).servos, np.eye(3)[[1, 0, 2]], strict=True):
            if generic.servo is not None:
                joint = robot.servos[generic.servo].joint
                axis = R_WT.T @ data.xaxis[model.joint(joint).id] * np.sign(generic.scale)
                assert axis @ wanted > 0.99, (name, generic.name)


def test_legs_and_hands_turn_as_their_convention_says(robot: Robot) -> None:
    """Positive directions, with straight legs and hanging arms: flexion, abduction and internal rotation of
    the hip, knee flexion, toes up, sole inwards; the wrist flexes towards the body and deviates towards the
    thumb."""
    assert robot.model is not None
    axes = {
        "leg": [(0, -1, 0), (1, 0, 0), (0, 0, -1), (0, 1, 0), (0, -1, 0), (-1, 0, 0)],
        "hand": [(-1, 0, 0), (0, -1, 0)],
    }
    kinematics = KinematicChain(robot)
    position = np.zeros(len(robot.servos))
    for part in robot.parts:
        if part.kind == "arm":
            joints = joint_map(robot, part.name)
            position[joints.servos] = joints.to_robot(np.zeros(5), position)
    found = 0
    for part in robot.parts:
        if part.kind not in axes:
            continue
        mirror = np.array([1.0, 1.0, 1.0] if part.side == "left" else [-1.0, 1.0, -1.0])
        for generic, wanted in zip(part.servos, axes[part.kind], strict=True):
            if generic.servo is None:
                continue
            moved = [link for link in kinematics.links if generic.servo in kinematics.chain(link)]
            axis = kinematics.jacobian(position, moved[-1])[3:, generic.servo] * np.sign(generic.scale)
            assert axis @ (mirror * wanted) > 0.96, (part.name, generic.name)
            found += 1
    legs_and_hands = {"icub-whole": 16, "talos": 16, "alex": 2}
    legs_and_hands |= dict.fromkeys(("nao-whole", "nao-plain", "nao-plain-h21"), 10)
    legs_and_hands |= dict.fromkeys(("g1", "g1-bare", "g1-hands", "g1-inspire"), 16)
    assert found == legs_and_hands.get(robot.name, 0)


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_the_whole_body_has_all_that_the_plain_robot_has(name: str) -> None:
    plain, whole = load_robot(name), load_robot(f"{name}-whole")
    assert whole.servos[: len(plain.servos)] == plain.servos
    assert {patch.name: patch for patch in plain.patches}.items() <= {
        p.name: p for p in whole.patches
    }.items()
    for part in plain.parts:
        if part.kind != "torso":
            assert whole.part(part.name) == part
    assert {part.kind for part in whole.parts} >= {"arm", "head", "torso", "leg"}


def test_the_bare_g1_is_the_g1_without_its_sleeves() -> None:
    worn, bare = load_robot("g1"), load_robot("g1-bare")
    assert (bare.servos, bare.parts, bare.couplings) == (worn.servos, worn.parts, worn.couplings)
    assert [patch.surface for patch in bare.patches] == [patch.surface for patch in worn.patches]
    assert not bare.skin
    assert worn.skin == worn.patches
