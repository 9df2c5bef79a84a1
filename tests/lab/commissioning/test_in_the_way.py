"""`tci check` says how a robot notices somebody in its way, and what it does then."""

from __future__ import annotations

import pytest

from tci.cli.check import remarks
from tci.robot.catalogue import load_robot


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nao", "noticed by skin on left_arm, right_arm, head, elsewhere by a joint that stays behind"),
        (
            "nao",
            "go back from whom they meet, softly in simulation, else stiffly; left_fingers, right_fingers",
        ),
        ("g1-bare", "in the way is noticed by a joint that stays behind"),
        (
            "g1-bare",
            "softly in simulation and over unitree, else and a waist stiffly; left_leg, right_leg never",
        ),
        ("allegro", "no part goes back from whom it meets"),
    ],
)
def test_what_a_robot_does_about_somebody_in_the_way_is_told(name: str, words: str) -> None:
    assert any(words in note for note in remarks(load_robot(name)))


def test_a_robot_without_masses_is_told_to_stay_stiff() -> None:
    bare = load_robot("nao").model_copy(update={"model": None, "digest": "bare"})
    assert any("go back from whom they meet, stiffly, since" in note for note in remarks(bare))
