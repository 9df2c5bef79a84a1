"""Exact retargeting: according to the models' own frames, the limbs of both robots have equal directions in
the torso frame."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tci.body.posture import to_platform
from tci.body.retarget import Retargeted, angle_between, in_torso, retarget, with_retargeting
from tci.errors import CommandError
from tci.messages import GenericCommand, Mode
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.generic_arm import forearm_rotation, upper_arm_rotation
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.shoulder import Shoulder, shoulder_of

NAMES, SIDES = ("nao", "icub"), ("left", "right")
ARMS = [(name, side) for name in NAMES for side in SIDES]
ROBOTS = {name: load_robot(name) for name in NAMES}
KINEMATICS = {name: KinematicChain(robot) for name, robot in ROBOTS.items()}
NAO_RANGE = np.deg2rad([[-10, 95.5], [0, 70], [-29.5, 65], [15, 88.5], [-60, 60]])
"""Range of generic angles [rad] that NAO reaches. iCub also reaches these angles in its own mount frame."""


HANDS = {
    ("nao", "left_arm"): "LHand",
    ("nao", "right_arm"): "RHand",
    ("icub", "left_arm"): "l_hand",
    ("icub", "right_arm"): "r_hand",
}


def limb_axes(name: str, part: str, position: Array) -> tuple[Array, Array]:
    """Returns unit vectors (3,) along upper arm and forearm in the torso frame, from MuJoCo's joint axes.

    The last shoulder joint turns about the upper arm. The first wrist joint turns about the forearm.
    """
    generic = ROBOTS[name].part(part)
    upper_arm, forearm = generic.segment("upper_arm"), generic.segment("forearm")
    hand = HANDS[name, part]
    poses = KINEMATICS[name].poses(position, [upper_arm.link, forearm.link, hand])
    shoulder, elbow = (
        (poses[segment.link] @ np.append(segment.origin, 1.0))[:3] for segment in (upper_arm, forearm)
    )
    servos = [generic.servos[id].servo for id in (2, 4)]
    upper, fore = KINEMATICS[name].jacobian(position, hand)[3:, servos].T
    return upper * np.sign(upper @ (elbow - shoulder)), fore * np.sign(fore @ (poses[hand][:3, 3] - elbow))


def ideal_axes(generic: Array, side: str) -> tuple[Array, Array]:
    """Returns the unit vectors of `limb_axes` for the generic arm itself."""
    down = np.array([0.0, 0.0, -1.0])
    return (
        upper_arm_rotation(generic, side, axial=False) @ down,
        forearm_rotation(generic, side, axial=False) @ down,
    )


def degrees(one: Array, other: Array) -> float:
    return float(np.rad2deg(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))


@pytest.mark.parametrize(("name", "side"), ARMS)
def test_axes_agree_in_the_torso_frame_wherever_limits_allow(name: str, side: str) -> None:
    robot, part = ROBOTS[name], f"{side}_arm"
    random = np.random.default_rng(5)
    reached, worst, missed = 0, 0.0, []
    for generic in random.uniform(*NAO_RANGE.T, size=(1000, 5)):
        answer = retarget(robot, part, generic, initial_position(robot))
        axes = limb_axes(name, part, answer.position)
        apart = [degrees(a, b) for a, b in zip(axes, ideal_axes(generic, side), strict=True)]
        assert_within_limits(robot, answer.position)
        if answer.reached:
            reached += 1
            worst = max(worst, *apart)
        else:
            missed.append(np.rad2deg(answer.upper_arm_error))
            assert apart[0] <= np.rad2deg(answer.upper_arm_error) + 1e-6
    print(
        f"{name} {side}: {reached} of 1000 to {worst:.0e} degrees; others off by {np.mean(missed or 0):.0f}"
    )
    assert worst <= 0.01
    assert reached >= (1000 if name == "nao" else 600)


def assert_within_limits(robot: Robot, position: Array) -> None:
    for servo in robot.servos:
        if servo.limits.lower is not None and servo.limits.upper is not None:
            assert servo.limits.lower - 1e-9 <= position[servo.index] <= servo.limits.upper + 1e-9
    for coupling in robot.couplings:
        value = position[list(coupling.servos)] @ np.array(coupling.coefficients)
        assert coupling.lower - 1e-6 <= value <= coupling.upper + 1e-6


def test_the_nearest_posture_is_the_nearest() -> None:
    """No posture on a fine grid within the limits is closer to the target than the returned posture."""
    robot = ROBOTS["icub"]
    random = np.random.default_rng(5)
    tries = random.uniform(*NAO_RANGE.T, size=(200, 5))
    answers = [retarget(robot, "right_arm", generic, initial_position(robot)) for generic in tries]
    generic, answer = next(
        (g, a) for g, a in zip(tries, answers, strict=True) if a.upper_arm_error > np.deg2rad(5.0)
    )
    turns = shoulder_of(robot, "right_arm")
    shoulder, wanted = turns.servos, turns.wanted(generic[:3], np.eye(3))
    grids = [np.linspace(low, high, 41) for low, high in zip(turns.lower, turns.upper, strict=True)]
    best = np.inf
    for angles in product(*grids):
        position = initial_position(robot).copy()
        position[shoulder] = angles
        try:
            assert_within_limits(robot, position)
        except AssertionError:
            continue
        best = min(best, angle_between(turns.rotation(np.array(angles)), wanted))
    assert answer.upper_arm_error <= best + 1e-6


@pytest.mark.parametrize(("name", "side"), ARMS)
def test_a_retargeted_arm_returns_to_its_generic_angles(name: str, side: str) -> None:
    """Beyond the limits a command asks for the nearest posture instead (tests/robot/test_shoulder.py)."""
    robot, part = with_retargeting(ROBOTS[name], f"{side}_arm"), f"{side}_arm"
    joints, random, within = joint_map(robot, part), np.random.default_rng(6), 0
    for generic in random.uniform(*NAO_RANGE.T, size=(200, 5)):
        for mode in (Mode.POSITION, Mode.IMPEDANCE):
            command = to_platform(robot, GenericCommand(part, mode, generic))
            position = initial_position(robot).copy()
            position[joints.servos] = exact = joints.to_robot(generic, position)
            np.testing.assert_allclose(joints.to_generic(position), generic, atol=1e-9)
            limits = [robot.servos[servo].limits for servo in command.servos]
            lower, upper = np.array([[one.lower, one.upper] for one in limits], dtype=float).T
            if np.all((exact >= lower) & (exact <= upper)):
                within += 1
                np.testing.assert_array_equal(command.values, exact)
            else:
                assert np.any((command.values < lower) | (command.values > upper))
    assert within > 200


@pytest.mark.parametrize(("name", "side"), ARMS)
def test_power_is_the_same_on_both_sides_of_a_retargeted_shoulder(name: str, side: str) -> None:
    robot, part = with_retargeting(ROBOTS[name], f"{side}_arm"), f"{side}_arm"
    joints = joint_map(robot, part)
    random = np.random.default_rng(7)
    for generic in random.uniform(*NAO_RANGE.T, size=(100, 5)):
        position = initial_position(robot).copy()
        position[joints.servos] = joints.to_robot(generic, position)
        velocity, torque = random.normal(size=(2, 5))
        v = to_platform(robot, GenericCommand(part, Mode.VELOCITY, velocity), position=position)
        t = to_platform(robot, GenericCommand(part, Mode.TORQUE, torque), position=position)
        assert v.values @ t.values == pytest.approx(velocity @ torque, abs=1e-9)
        later, h = position.copy(), 1e-6
        later[v.servos] += h * v.values
        np.testing.assert_allclose((joints.to_generic(later) - generic) / h, velocity, atol=1e-4)


def test_an_arm_on_its_mount_and_retargeted_in_the_torso_frame_are_the_same_shoulder() -> None:
    robot = ROBOTS["icub"]
    part = robot.part("left_arm")
    random = np.random.default_rng(8)
    for generic in random.uniform(*NAO_RANGE.T, size=(50, 5)):
        command = to_platform(robot, GenericCommand("left_arm", Mode.POSITION, generic))
        position = initial_position(robot).copy()
        position[command.servos] = command.values
        exact = with_retargeting(robot, "left_arm")
        seen = joint_map(exact, "left_arm").to_generic(position)
        wanted = part.R_TM @ upper_arm_rotation(generic, "left", axial=True)
        np.testing.assert_allclose(upper_arm_rotation(seen, "left", axial=True), wanted, atol=1e-6)


def test_slanted_axes_are_solved_too() -> None:
    """The shoulder axes are not at right angles, as on a Unitree G1."""
    shoulder = Shoulder(ROBOTS["nao"], ROBOTS["nao"].part("left_arm"))
    random = np.random.default_rng(9)
    for _ in range(200):
        tilt = Rotation.from_rotvec(random.normal(scale=0.3, size=3)).as_matrix()
        shoulder.axes = np.array([tilt @ shoulder.axes[0], shoulder.axes[1], tilt.T @ shoulder.axes[2]])
        angles = random.uniform(-1.0, 1.0, 3)
        wanted = shoulder.rotation(angles)
        ways = shoulder.solutions(wanted)
        assert min(angle_between(shoulder.rotation(way), wanted) for way in ways) < 1e-7
        shoulder = Shoulder(ROBOTS["nao"], ROBOTS["nao"].part("left_arm"))


def test_what_is_no_arm_or_no_posture_is_refused() -> None:
    robot = ROBOTS["nao"]
    for part, generic in (("head", np.zeros(5)), ("left_arm", np.zeros(3)), ("left_arm", np.full(5, np.nan))):
        with pytest.raises(CommandError, match="valid: an arm, and 5 finite angles"):
            retarget(robot, part, generic, initial_position(robot))
    assert isinstance(retarget(robot, "left_arm", np.full(5, 0.5), initial_position(robot)), Retargeted)


def test_joints_that_turn_more_than_once_do_not_wind_up() -> None:
    """With the 360 degrees to both sides of a real UR5, its pan went 338 degrees from -11 to 11."""
    robot = load_robot("ur5")
    wide = {"lower": -2.0 * np.pi, "upper": 2.0 * np.pi}
    servos = [one.model_copy(update={"limits": one.limits.model_copy(update=wide)}) for one in robot.servos]
    robot = robot.model_copy(update={"servos": tuple(servos)})
    part, joints = robot.part("left_arm"), joint_map(robot, "left_arm")
    for pan in np.linspace(-1.0, 1.0, 6):
        position = initial_position(robot).copy()
        position[0] += pan
        found = retarget(robot, "left_arm", in_torso(part, joints.to_generic(position)), position)
        np.testing.assert_allclose(found.position, position, atol=1e-6)
