"""A hand alone, held by a stand: its fingers bend to the palm, judged by MuJoCo on the maker's model, and it
lets go when one is pressed."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from helpers.mujoco_oracle import posed
from tci.capabilities import FingerReflex
from tci.messages.frames import Array
from tci.robot.description import Robot

TIPS = {"thumb": "link_15.0_tip", "index": "link_3.0_tip", "middle": "link_7.0_tip", "ring": "link_11.0_tip"}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return tci.load_robot("allegro")


def tips(robot: Robot, **angles: float) -> dict[str, Array]:
    """Place (3,) [m] of each finger tip, all generic joints at zero but for `angles` [degrees]."""
    part = robot.parts[0]
    data = posed(robot, part.name, np.deg2rad([angles.get(one.name, 0.0) for one in part.servos]))
    return {name: np.array(data.body(link).xpos) for name, link in TIPS.items()}


def test_fingers_bend_forward_over_the_palm_and_spread_from_the_middle_one(robot: Robot) -> None:
    """In the model's frame the palm faces +x, and the fingers point up."""
    assert [part.name for part in robot.parts] == ["right_fingers"]
    straight = tips(robot)
    for name in ("index", "middle", "ring"):
        bent = tips(robot, **{f"{name}_flexion": 40.0})
        assert bent[name][0] > straight[name][0] + 0.03, name
        others = [one for one in TIPS if one != name]
        np.testing.assert_allclose([bent[one] for one in others], [straight[one] for one in others])
    opposed = tips(robot, thumb_spread=70.0)["thumb"] - tips(robot, thumb_spread=20.0)["thumb"]
    assert opposed[0] > 0.02
    bent = dict.fromkeys(("index_flexion", "middle_flexion", "ring_flexion"), 60.0)
    for name in ("index", "ring"):  # the joint lies along the finger: it spreads bent fingers
        close, wide = (tips(robot, **bent, **{f"{name}_spread": angle}) for angle in (0.0, 15.0))
        far = [float(np.linalg.norm(at[name] - at["middle"])) for at in (close, wide)]
        assert far[1] > far[0] + 0.005, name


def test_it_lets_go_when_a_finger_is_pressed(robot: Robot) -> None:
    with tci.connect(robot, "sim") as driver:
        driver.world.finger.poke("right_index_tip", 4)
        result = tci.run(driver, FingerReflex(), duration=0.8)
    assert "right_index_tip" in str(result)
    assert "; moved" in str(result)
    assert result.state.name == "RUN"
