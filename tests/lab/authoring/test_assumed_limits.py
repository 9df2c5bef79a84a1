"""Figures of a model that can't be meant are never replaced by more permissive ones, and never in silence."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from helpers.made_humanoid import MadeHumanoid
from tci.lab.authoring.assumed_limits import assumed_limits
from tci.lab.authoring.joint_facts import JointFacts, proposed_limits
from tci.lab.authoring.proposal import propose
from tci.robot.description import Limits, Robot


def made(folder: Path, limits: dict[str, str], *, mjcf: bool = False) -> Robot:
    """The proposal for a humanoid without legs, with other attributes of `<limit>` by joint."""
    humanoid = MadeHumanoid(legs=False)
    path = humanoid.urdf(folder)
    text = path.read_text()
    for joint, limit in limits.items():
        text, count = re.subn(
            rf"(<joint name='{joint}'.*?)<limit [^>]*/>", rf"\1<limit {limit}/>", text, count=1
        )
        assert count
    path.write_text(text)
    if mjcf:
        import mujoco

        path = folder / "made.xml"
        path.write_text(mujoco.MjSpec.from_file(str(folder / "made.urdf")).to_xml())
    return propose(path, name="made", cover=False)


def limits_of(robot: Robot, joint: str) -> Limits:
    return next(servo.limits for servo in robot.servos if servo.joint == joint)


def told(robot: Robot, *words: str) -> bool:
    return any(all(word in line for word in words) for line in assumed_limits(robot))


@pytest.mark.parametrize("mjcf", [False, True])
@pytest.mark.parametrize(
    ("written", "lower", "upper"),
    [
        ((-126.0, 6.0), -126.0, 6.0),
        ((-300.0, 20.0), -300.0, 20.0),
        ((-6.5, 0.1), -180.0, np.rad2deg(0.1)),
        ((-1e4, 0.1), -180.0, np.rad2deg(0.1)),
        ((-2.0, 0.1), np.rad2deg(-2.0), np.rad2deg(0.1)),
    ],
)
def test_a_range_is_never_widened(
    tmp_path: Path, written: tuple[float, float], lower: float, upper: float, mjcf: bool
) -> None:
    limit = f"lower='{written[0]}' upper='{written[1]}' effort='30' velocity='6'"
    robot = made(tmp_path, {f"{side}_elbow": limit for side in ("left", "right")}, mjcf=mjcf)
    for side in ("left", "right"):
        found = limits_of(robot, f"{side}_elbow")
        assert (found.lower, found.upper) == pytest.approx(tuple(np.deg2rad([lower, upper])))
        meant = written == (-2.0, 0.1)
        assert ("lower" in found.assumed) is not meant
        assert told(robot, f"{side}_elbow", "turn", f"{written[0]:.4g}") is not meant


def test_what_one_side_lacks_is_taken_from_the_other(tmp_path: Path) -> None:
    robot = made(
        tmp_path,
        {
            "left_elbow": "lower='-2.2' upper='0.1' effort='0' velocity='0'",
            "right_elbow": "lower='-2.2' upper='0.1' effort='21' velocity='2'",
            "left_shoulder_roll": "lower='-0.2' upper='2' effort='30' velocity='6'",
            "right_shoulder_roll": "effort='30' velocity='1e6'",
        },
    )
    elbow, roll = limits_of(robot, "left_elbow"), limits_of(robot, "right_shoulder_roll")
    assert (elbow.torque, elbow.velocity) == pytest.approx((21.0, 2.0), rel=1e-3)
    assert {"torque", "velocity"} <= set(elbow.assumed)
    assert (roll.lower, roll.upper, roll.velocity) == pytest.approx((-2.0, 0.2, np.deg2rad(120.0)), rel=1e-3)
    assert {"lower", "upper", "velocity"} <= set(roll.assumed)
    assert told(robot, "torque 21 N m", "left_elbow", "other side")
    assert told(robot, "range -114.6 to 11.46", "right_shoulder_roll", "no range")
    assert told(robot, "right_shoulder_roll", "1e+06 rad/s", "placeholder")
    assert not limits_of(robot, "right_elbow").assumed[2:]


def test_ranges_that_are_no_mirror_images_are_told(tmp_path: Path) -> None:
    robot = made(tmp_path, {"left_elbow": "lower='-1.2' upper='0.1' effort='30' velocity='6'"})
    assert told(robot, "left_elbow", "right_elbow", "mirror")
    assert not told(robot, "left_shoulder_yaw")


DEVICE = """
<link name='{name}_link'><inertial><mass value='0.2'/>
  <inertia ixx='1e-4' iyy='1e-4' izz='1e-4' ixy='0' ixz='0' iyz='0'/></inertial></link>
<joint name='{name}' type='{type}'><parent link='{parent}'/><child link='{name}_link'/>
  <origin xyz='0 {y} {z}'/><axis xyz='{axis}'/>{limit}</joint>
"""


@pytest.mark.parametrize(
    ("name", "axis", "on_head", "limit"),
    [
        ("lidar_spin", "1 0 0", True, ""),
        ("j7", "0 0 1", False, ""),
        ("head_hokuyo_joint", "1 0 0", True, ""),
        ("spinner", "1 0 0", True, "<limit lower='-1e16' upper='1e16' effort='1' velocity='1'/>"),
    ],
)
def test_what_spins_is_no_neck(tmp_path: Path, name: str, axis: str, on_head: bool, limit: str) -> None:
    head = ("pitch",) if on_head else ()
    path = MadeHumanoid(legs=False, head=head).urdf(tmp_path)
    parent, y, z = ("head_0_pitch_link", -0.03, 0.1) if on_head else ("torso", 0, 0.5)
    device = DEVICE.format(
        name=name, axis=axis, parent=parent, y=y, z=z, limit=limit, type="revolute" if limit else "continuous"
    )
    path.write_text(path.read_text().replace("</robot>", f"{device}</robot>"))
    robot = propose(path, name="made", cover=False)
    used = [robot.servos[one.servo].joint for one in robot.part("head").servos if one.servo is not None]
    assert used == ["head_0_pitch"] * on_head
    assert name in [servo.joint for servo in robot.servos]


def test_a_neck_without_a_range_stays_a_neck(tmp_path: Path) -> None:
    path = MadeHumanoid(legs=False).urdf(tmp_path)
    text = re.sub(r"(name='head_0_yaw' type=)'revolute'", r"\1'continuous'", path.read_text())
    path.write_text(text)
    head = propose(path, name="made", cover=False).part("head")
    assert sum(one.servo is not None for one in head.servos) == 2


def first_motion(acceleration: float, jerk: float) -> float:
    """Time [s] until a servo has moved by 0.05 degrees that follows its reference with two poles of 5 ms; the
    reference is told every 2 ms, a period ahead, and starts at full jerk."""
    step, ramp, angle, speed, now = 1e-5, acceleration / jerk, 0.0, 0.0, 0.0

    def reference(t: float) -> float:
        if t < ramp:
            return jerk * t**3 / 6.0
        return (
            jerk * ramp**3 / 6.0
            + 0.5 * acceleration * ramp * (t - ramp)
            + 0.5 * acceleration * (t - ramp) ** 2
        )

    while angle < np.deg2rad(0.05):
        told = 2e-3 * int(now / 2e-3)
        share = (now - told) / 2e-3
        asked = (1.0 - share) * reference(told) + share * reference(told + 2e-3)
        speed += step * ((asked - angle) / 5e-3**2 - 2.0 * speed / 5e-3)
        angle, now = angle + step * speed, now + step
    return now


@pytest.mark.parametrize("able", [35.0, 50.0, 120.0, 1e4])
def test_a_proposed_joint_starts_in_time_for_a_reflex(able: float) -> None:
    """Besides a frame of the skin, `check --simulate` gives a reflex 23 ms until the arm moves. `able`
    [rad/s2] is what the full torque gives to a joint, which may need a third of it and has it after 10 ms."""
    limits = proposed_limits(JointFacts(-1.0, 1.0, velocity=3.0, torque=0.6 * able), 0.6)
    assert limits.acceleration is not None
    assert limits.jerk is not None
    assert first_motion(limits.acceleration, limits.jerk) <= 23e-3
    assert limits.acceleration <= 0.36 * able
    assert limits.jerk * 10e-3 <= 1.001 * able
