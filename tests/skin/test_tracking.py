"""A contact keeps its identity while it lasts, moves over the skin or flickers. No other contact ever has
this identity."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import TciError
from tci.messages import Reading
from tci.simulation.world import World
from tci.skin.kernels.arrays import ContactArrays
from tci.skin.tracking import Tracker, TrackSettings


def places(*x: float) -> np.ndarray:
    return np.array([[value, 0.0, 0.0] for value in x]).reshape(-1, 3)


def follow(
    tracker: Tracker, patch: str, centres: np.ndarray, stamp: float
) -> list[tuple[float, float, float]]:
    """Returns identity, onset and displacement of contacts that consist of one taxel each."""
    made = ContactArrays.empty(len(centres), len(centres))
    rows = made.rows
    rows["site"], rows["p_L"] = ("arm", "hand").index(patch), centres
    made.begin[:], made.taxels["taxel"] = np.arange(len(centres) + 1), np.arange(len(centres))
    tracker.follow(made, np.full(2, stamp))
    return rows[["identity", "onset", "displacement"]].tolist()


def identities(tracker: Tracker, *x: float, at: float, patch: str = "arm") -> list[float]:
    return [one[0] for one in follow(tracker, patch, places(*x), at)]


def test_it_lasts_while_the_contact_moves_in_steps() -> None:
    tracker = Tracker()
    first = follow(tracker, "arm", places(0.0), 0.0)
    assert first == [(1, 0.0, 0.0)]
    for step in range(1, 11):
        ((identity, began, moved),) = follow(tracker, "arm", places(0.02 * step), 0.02 * step)
        assert (identity, began) == (1, 0.0)
        assert moved == pytest.approx(0.02 * step)


def test_the_nearest_pairs_are_the_same_in_whatever_order_they_come() -> None:
    tracker = Tracker()
    assert identities(tracker, 0.0, 0.02, 0.1, at=0.0) == [1, 2, 3]
    assert identities(tracker, 0.101, 0.005, 0.021, at=0.02) == [3, 1, 2]


def test_what_is_too_far_is_new_and_what_is_left_has_ended() -> None:
    tracker = Tracker()
    assert identities(tracker, 0.0, at=0.0) == [1]
    assert identities(tracker, 0.05, at=0.02) == [2]
    # within the time `linger` the contact keeps its identity
    assert identities(tracker, 0.0, 0.05, at=0.04) == [1, 2]
    assert identities(tracker, at=0.06) == []
    assert identities(tracker, 0.0, at=0.2) == [3]


def test_patches_have_nothing_to_do_with_each_other() -> None:
    tracker = Tracker()
    assert identities(tracker, 0.0, at=0.0, patch="arm") == [1]
    assert identities(tracker, 0.0, at=0.0, patch="hand") == [2]
    assert identities(tracker, 0.0, at=0.02, patch="arm") == [1]


@given(
    frames=st.lists(st.lists(st.floats(-0.2, 0.2), max_size=6), min_size=1, max_size=20),
    reach=st.floats(0.0, 0.1),
)
def test_no_two_contacts_share_an_identity_and_none_jumps(frames: list[list[float]], reach: float) -> None:
    tracker = Tracker(TrackSettings(reach=reach))
    last: dict[int, tuple[float, float]] = {}
    for count, x in enumerate(frames):
        found = follow(tracker, "arm", places(*x), 0.02 * count)
        assert len({identity for identity, _, _ in found}) == len(x)
        for (identity, began, _), place in zip(found, x, strict=True):
            if identity in last:
                assert abs(last[identity][1] - place) <= reach + 1e-12
                assert began == last[identity][0]
            else:
                assert began == 0.02 * count
            last[identity] = (began, place)


@pytest.mark.parametrize("settings", [{"reach": -0.1}, {"linger": float("nan")}, {"reach": float("inf")}])
def test_bad_settings(settings: dict[str, float]) -> None:
    with pytest.raises(TciError, match=next(iter(settings))):
        TrackSettings(**settings)


def test_one_poke_is_one_contact_from_its_beginning_to_its_end() -> None:
    world = World(tci.load_robot("nao"))
    world.finger.poke("left_forearm", 120, speed=0.2, depth=0.01)
    perceiver = Perceiver(GenericBody(world.robot))
    seen, ended = [], []
    for period in range(1, 60):
        world.advance(0.02 * period)
        if period == 30:
            world.finger.retire()
        perception = perceiver.step(Reading(world.joints(), world.frames()), world.time)
        seen += [(contact.identity, contact.onset, contact.stamp) for contact in perception.contacts]
        ended += perception.ended
    assert {identity for identity, _, _ in seen} == {1}
    assert {began for _, began, _ in seen} == {seen[0][2]}
    assert ended == [1]
