"""Pairs of links that are close together in every posture are not checked for collision. Pairs that meet only
in some postures are checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from helpers.made_humanoid import MadeHumanoid
from tci.lab.authoring.initial_posture import with_initial
from tci.lab.authoring.proposal import propose
from tci.robot.clearance import Clearance
from tci.robot.collisions import NEAR
from tci.robot.joint_map import initial_position


def shoulders(folder: Path, *, above: float, aside: float) -> tuple[set[tuple[str, str]], float]:
    """Returns the checked pairs of links, and the least distance [m] in the initial posture, for a made
    humanoid. The second link of each shoulder is a ball at `aside` [m] from its joint. The torso has another
    ball at `above` [m] over each of these balls."""
    path = MadeHumanoid(legs=False).urdf(folder)
    text = path.read_text()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        start = text.index("<collision>", text.index(f"<link name='{side}_shoulder_roll_link'>"))
        end = text.index("</link>", start)
        text = text[:start] + ball(f"{aside} 0 0") + text[end:]
        end = text.index("</link>", text.index("<link name='torso'>"))
        text = text[:end] + ball(f"{aside} {0.17 * sign} {0.3 + 2.0 * RADIUS + above}") + text[end:]
    path.write_text(text)
    proposed = propose(path, name="made")
    parts = [with_initial(proposed, one) if one.kind == "arm" else one for one in proposed.parts]
    robot = proposed.model_copy(update={"parts": tuple(parts), "digest": "not clear of the body"})
    clearance = Clearance(robot)
    near = clearance.gap(np.array(initial_position(robot)), within=1.0).distance
    return {clearance.names(pair) for pair in range(len(clearance.pairs))}, near


RADIUS = 0.02


def ball(place: str) -> str:
    """Returns the XML of a spherical collision shape."""
    shape = f"<geometry><sphere radius='{RADIUS}'/></geometry>"
    return f"<collision><origin xyz='{place}'/>{shape}</collision>"


def test_links_that_are_near_whatever_the_posture_do_not_collide(tmp_path: Path) -> None:
    """The second link of a shoulder turns about its own middle, 4 mm below a ball of the torso."""
    pairs, near = shoulders(tmp_path, above=0.004, aside=0.0)
    assert ("torso", "left_shoulder_roll_link") not in pairs
    assert ("torso", "left_shoulder_yaw_link") in pairs
    assert near > 0.005


def test_links_that_meet_by_moving_do(tmp_path: Path) -> None:
    """A motion of the shoulder moves the ball of its second link past the ball of the torso."""
    pairs, near = shoulders(tmp_path, above=-0.012, aside=-0.05)
    assert ("torso", "left_shoulder_roll_link") in pairs
    assert 0.0 < near < NEAR
