"""Descriptions proposed from a URDF agree with those written by hand."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.lab.authoring.proposal import propose
from tci.lab.commissioning.plausibility import doubts
from tci.lab.experiments.verdict import weight_faults
from tci.messages.frames import rotation_rpy, rpy_of
from tci.robot.catalogue import load_robot
from tci.robot.description import TruncatedCone
from tci.robot.xml import read_robot
from tci.robot.xml.model import packaged
from tci.robot.xml.writer import write_robot

MADE = {
    "g1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "talos": "talos_data/robots/talos_full_v2.urdf",
    "alex": "alex_description/urdf/alex_nub_hands.urdf",
}


def model_file(package: str, file: str) -> Path:
    path = packaged(package, file)
    assert path is not None
    return path


FITTED = 1e-4
"""Tolerance [m, rad]. Fits to equal meshes differ by 0.02 mm between processors; for comparison, a taxel is 6
mm wide."""


PLACEHOLDERS = ("RightShoulderPitch", "RightShoulderRoll", "RightShoulderYaw", "RightElbowPitch")
"""Servos of Alex to which the maker's file gives 1000 N m and no speed: the packaged robot has those of the
left arm."""


def leaves(value: object, place: str = "") -> Iterator[tuple[str, object]]:
    """Yields the path and value of each leaf in nested lists and dictionaries."""
    if isinstance(value, dict | list | tuple):
        for key, one in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(one, f"{place}/{key}")
    else:
        yield place, value


@pytest.mark.parametrize("name", MADE)
def test_the_packaged_robot_comes_out_again(name: str, tmp_path: Path) -> None:
    path = model_file("example-robot-data", MADE[name])
    proposed = propose(path, name=name, package="example-robot-data")
    target = tmp_path / "robot.xml"
    target.write_text(write_robot(proposed, file=MADE[name], extra="robots"))
    again, shipped = read_robot(target), load_robot(name)
    described = {"parts", "servos", "model", "patches"}
    found, expected = (dict(leaves(robot.model_dump(include=described))) for robot in (again, shipped))
    servos = {servo.name: servo for servo in shipped.servos}
    right_ones = PLACEHOLDERS if name == "alex" else ()
    by_hand = ["/eyes", *(f"/servos/{servos[right].index}/limits/" for right in right_ones)]
    expected, found = (
        {key: value for key, value in one.items() if not any(hand in key for hand in by_hand)}
        for one in (expected, found)
    )
    assert found == pytest.approx(expected, abs=FITTED)
    for right in right_ones:
        ours, left = servos[right].limits, servos[right.replace("Right", "Left")].limits
        assert (ours.torque, ours.velocity) == (left.torque, left.velocity)


def test_arms_that_hang_on_springs_are_doubted_and_not_refused() -> None:
    """PR2's shoulders have 30 N m, their arms take 52."""
    proposed = propose(model_file("example-robot-data", "pr2_description/urdf/pr2.urdf"), name="pr2")
    assert not [*weight_faults(proposed)]
    assert len([one for one in doubts(proposed) if "shoulder_lift_joint: torque limit of 30 N m" in one]) == 2


def test_a_model_without_a_joint_that_turns_is_refused_in_words() -> None:
    with pytest.raises(DescriptionError, match="no mirrored limbs"):
        propose(model_file("example-robot-data", "iris_description/robots/iris_simple.urdf"), name="iris")


def test_an_icub_is_found_as_people_described_it() -> None:
    """The root of the model faces backward and the torso link lies on its side. The proposal recognises
    both."""
    icub = load_robot("icub")
    assert icub.model is not None
    proposed = propose(Path(icub.model.path), name="icub")
    assert proposed.model is not None
    assert proposed.model.torso_link == icub.model.torso_link
    np.testing.assert_allclose(proposed.model.T_LT[:3, :3], icub.model.T_LT[:3, :3], atol=1e-3)
    for part in (part for part in icub.parts if part.kind != "fingers"):  # the model has no movable fingers
        for ours, theirs in zip(proposed.part(part.name).servos, part.servos, strict=True):
            assert theirs.servo is not None
            assert ours.servo is not None
            assert proposed.servos[ours.servo].joint == icub.servos[theirs.servo].joint
            if ours.transform == "linear":
                assert ours.scale == theirs.scale, (part.name, ours.name)
                assert ours.offset == pytest.approx(theirs.offset, abs=1e-3), (part.name, ours.name)
        for ours, theirs in zip(proposed.part(part.name).segments, part.segments, strict=True):
            assert ours.length == pytest.approx(theirs.length, abs=0.02)


def test_an_icub_gets_its_mount_its_legs_and_its_hands() -> None:
    """The proposal agrees with the handwritten description `icub-whole`: equation 1 with a mount of 15
    degrees, six joints of a leg, two joints of a wrist."""
    icub = load_robot("icub-whole")
    assert icub.model is not None
    proposed = propose(Path(icub.model.path), name="icub", linear=True)
    for side in ("left", "right"):
        ours, theirs = proposed.part(f"{side}_arm"), icub.part(f"{side}_arm")
        np.testing.assert_allclose(ours.mount, theirs.mount, atol=1e-4)
        assert {joint.transform for joint in ours.servos} == {"linear"}
        for kind in ("arm", "leg", "hand"):
            pairs = zip(
                proposed.part(f"{side}_{kind}").servos, icub.part(f"{side}_{kind}").servos, strict=True
            )
            for one, other in pairs:
                assert one.servo is not None
                assert other.servo is not None
                assert proposed.servos[one.servo].joint == icub.servos[other.servo].joint, one.name
                assert one.scale == other.scale, one.name
                assert one.offset == pytest.approx(other.offset, abs=np.deg2rad(1.0)), one.name
        for one, other in zip(
            proposed.part(f"{side}_leg").segments, icub.part(f"{side}_leg").segments, strict=False
        ):
            assert (one.name, one.link) == (other.name, other.link)


def test_hips_of_another_order_are_found_too() -> None:
    """The hips of Talos and Romeo turn about z, x, y. The robot alex has no legs, and tiago_pro has
    wheels."""
    files = {
        "talos_data/robots/talos_full_v2.urdf": 6,
        "romeo_description/urdf/romeo.urdf": 6,
        "tiago_pro_description/robots/tiago_pro.urdf": 0,
    }
    for file, joints in files.items():
        proposed = propose(model_file("example-robot-data", file), name="x")
        legs = [part for part in proposed.parts if part.kind == "leg"]
        assert len(legs) == (2 if joints else 0)
        for part in legs:
            assert sum(one.servo is not None for one in part.servos) == joints


def test_skin_goes_around_the_arm() -> None:
    for patch in load_robot("g1").patches:
        assert isinstance(patch.surface, TruncatedCone)
        assert (
            0.025 < min(patch.surface.r1, patch.surface.r2) <= max(patch.surface.r1, patch.surface.r2) < 0.05
        )


def test_a_forearm_that_ends_nowhere_is_refused(tmp_path: Path) -> None:
    """All joints of this arm are at the elbow."""
    words = ["<link name='torso'/>"]
    for side, sign in (("left", 1), ("right", -1)):
        above = "torso"
        for name, axis, origin in (
            ("pitch", "0 -1 0", f"0 {0.2 * sign} 0.3"), ("roll", f"{sign} 0 0", "0 0 0"),
            ("yaw", f"0 0 {-sign}", "0 0 0"), ("elbow", "0 -1 0", "0 0 -0.25"),
            ("turn", f"0 0 {-sign}", "0 0 0"),
        ):  # fmt: skip
            link = f"{side}_{name}_link"
            words.append(
                f"<link name='{link}'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' ixy='0'"
                f" ixz='0' iyz='0'/></inertial></link><joint name='{side}_{name}' type='revolute'>"
                f"<parent link='{above}'/><child link='{link}'/><origin xyz='{origin}'/><axis xyz='{axis}'/>"
                "<limit lower='-1.5' upper='1.5' effort='20' velocity='4'/></joint>"
            )
            above = link
    path = tmp_path / "stub.urdf"
    path.write_text(f"<robot name='stub'>{''.join(words)}</robot>")
    with pytest.raises(DescriptionError, match="nothing after left_elbow shows where the left forearm ends"):
        propose(path, name="stub")


def test_what_is_no_humanoid_is_refused() -> None:
    dog = model_file("example-robot-data", "a1_description/urdf/a1.urdf")
    with pytest.raises(DescriptionError, match="valid: a humanoid whose z or y is up"):
        propose(dog, name="dog")


@pytest.mark.parametrize("rpy", [(0.1, -0.4, 2.0), (0.3, np.pi / 2, 0.0), (-2.0, -np.pi / 2, 0.7)])
def test_rpy_of(rpy: tuple[float, float, float]) -> None:
    rotation = rotation_rpy(*rpy)
    np.testing.assert_allclose(rotation_rpy(*rpy_of(rotation)), rotation, atol=1e-12)
