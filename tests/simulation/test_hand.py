"""A person's hand: it holds the asked force at the asked place, and goes away."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.errors import CommandError, TciError, UnknownNameError
from tci.simulation import HandPath
from tci.simulation.hand import Hand
from tci.simulation.world import World


@pytest.fixture(scope="module")
def nao() -> World:
    return World("nao", people=1)


def press(world: World, hand: Hand, random: np.random.Generator, pad: str, force: float) -> bool:
    """Presses a random taxel for a second; False if there is no room."""
    name = str(random.choice(list(world.surfaces)))
    surface = world.surfaces[name]
    taxel = int(random.integers(len(surface.positions)))
    world.reset()
    try:
        hand.touch(
            HandPath(
                link=surface.link, times=[0.0, 1.0], points=surface.positions[taxel],
                normals=surface.normals[taxel], forces=[force, force], pads=(pad,),
            )
        )  # fmt: skip
    except TciError:
        return False
    return True


def test_it_holds_the_asked_force_on_a_resting_arm_anywhere(nao: World) -> None:
    random, hand, done = np.random.default_rng(3), nao.person().right, 0
    for trial in range(16):
        force = float(np.exp(random.uniform(np.log(0.5), np.log(6.0))))
        if not press(nao, hand, random, ("index", "palm")[trial % 2], force):
            continue
        nao.advance(1.6)
        time, _, felt = hand.trace[:, :3].T
        assert hand.first_contact is not None
        late = (time > hand.first_contact + 0.3) & (time < hand.first_contact + 0.85)
        assert felt[late] == pytest.approx(force, rel=0.1), (trial, force)
        assert not hand.busy
        assert hand.force == 0.0
        done += 1
    assert done >= 8


def test_a_wrong_path_or_hand_says_what_is_valid(nao: World) -> None:
    one = {"link": "LForeArm", "times": [0.0, 1.0], "points": [0.0, 0.0, 0.0], "normals": [0.0, 0.0, 1.0],
           "forces": [1.0, 1.0]}  # fmt: skip
    for change, words in (
        ({"times": [0.0, 0.0]}, "rising"), ({"forces": [-1.0, 1.0]}, "at least 0 N"),
        ({"points": [0.0, 0.0]}, "valid: "), ({"normals": [0.0, 0.0, 0.0]}, "above 0"),
    ):  # fmt: skip
        with pytest.raises(CommandError, match=words):
            HandPath(**{**one, **change})  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="palm"):
        HandPath(**one, pads=("toe",))  # type: ignore[arg-type]
    with pytest.raises(UnknownNameError, match="link"):
        nao.person().left.touch(HandPath(**{**one, "link": "Wing"}))  # type: ignore[arg-type]
    with pytest.raises(CommandError, match="people=1"):
        tci.World("nao", skin=False).person()
