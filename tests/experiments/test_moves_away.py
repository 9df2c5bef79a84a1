"""No capability moves the skin towards an object that touches the skin. The simulated contact force is the
criterion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tci
from pressing import RISE, press, tally, with_pad
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


@pytest.mark.parametrize("name", tci.robot_names())
def test_no_answer_raises_the_force(name: str, tmp_path: Path) -> None:
    found = tally(name, seed=1, count=6, folder=tmp_path)
    print(f"{found.answered} of {found.touches} answered, {found.refused} refused")
    assert not found.rises
