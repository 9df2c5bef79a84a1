"""No capability moves the skin towards an object that touches the skin. The simulated contact force is the
criterion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.pressing import RISE, press, tally, with_pad
from helpers.robot_groups import two_armed
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.soft_reaction import SoftReaction
from tci.simulation.world import World

PALM = {"centre": np.array([0.07, -0.02, 0.0]), "normal": np.array([0.0, -1.0, 0.0])}
"""A pad on G1's left palm, in the frame of the wrist link."""


def test_a_pad_on_the_palm_alone_is_never_pushed_into_the_touch(tmp_path: Path) -> None:
    """The back of the hand has no skin, so the fields of the hand's back must not respond."""
    robot = with_pad(tci.load_robot("g1"), "left_hand", "left_wrist_yaw_link", tmp_path, **PALM)
    world = World(robot)
    told = [press(world, "pad", taxel, BodyWithdrawal(), depth=0.005, watch=0.2) for taxel in range(0, 25, 3)]
    assert max(one.rise for one in told) <= RISE, told
    assert any(one.answered for one in told)


def test_joints_that_would_move_are_judged_not_the_ones_that_are_asked_to() -> None:
    """Near a singular posture of talos' shoulder, two joints turn in opposite directions. In an earlier
    version one joint was at its limit, and the motion of the other joint pressed the forearm against the
    finger by 0.012 N."""
    robot = tci.load_robot("talos")
    arm = np.array([0.008726646259971648, 0.0, 0.5147832503647392, 1.4001612077879892, -2.5132741228718345])
    world = World(robot, posture={"left_arm": arm})
    reaction = SoftReaction(parts=("left_arm",))
    touched = press(world, "left_forearm", 127, reaction, depth=0.0038167317853585745)
    assert touched.rise <= RISE
    assert "press left_forearm" in "".join(touched.notes)


def test_other_skin_of_the_part_is_not_moved_into_the_object(tmp_path: Path) -> None:
    """A pad stands across an iCub's shank, and the finger is in the corner between the two. In an earlier
    version the pad moved away from the finger, the shank met the finger, and the force rose by 99 N."""
    place = {
        "centre": np.array([-0.01852979, -0.01124647, -0.00217569]),
        "normal": np.array([-0.87063325, -0.43875588, -0.22246576]),
    }
    robot = tci.load_robot("icub-whole")
    robot = with_pad(robot, "right_leg", "r_lower_leg_skin_35", tmp_path, segment="shank", **place)
    leg = np.array([0.2902, 1.2482, 1.0688, 0.4785, -0.1924, -0.2943])
    world = World(robot, posture={"right_leg": leg})
    corner, free = (
        press(world, patch, taxel, SoftReaction(parts=("right_leg",)), depth=0.0055)
        for patch, taxel in (("pad", 8), ("right_shank", 0))
    )
    assert corner.rise <= RISE
    assert "other skin" in "".join(corner.notes)
    assert free.answered
    assert free.rise <= RISE


@pytest.mark.parametrize("name", [*two_armed(), "ur5"])
def test_no_answer_raises_the_force(name: str, tmp_path: Path) -> None:
    found = tally(name, seed=1, count=6, folder=tmp_path)
    print(f"{found.answered} of {found.touches} answered, {found.refused} refused")
    assert not found.rises
