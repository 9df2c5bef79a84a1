"""What a history of contacts says about every contact is what a list of all frames says."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tci.errors import TciError
from tci.messages import ContactHistory, Contacts, Perception, Site
from tci.messages.contacts import CONTACT, TAXEL
from tci.testing import TouchedRobot

SITES = (Site("front", "torso", ""), Site("forearm", "left_arm", "forearm"))
DT = 0.01


class Felt(NamedTuple):
    """One step: which patches have a new frame, and the force [N] of each contact, by identity. Contacts with
    an even identity are on the first patch."""

    fresh: tuple[bool, bool]
    forces: dict[int, float]


FELT = st.lists(
    st.builds(
        Felt,
        st.tuples(st.booleans(), st.booleans()),
        st.dictionaries(st.integers(1, 4), st.floats(0.5, 9.0), max_size=3),
    ),
    max_size=40,
)


def perceptions(steps: Sequence[Felt]) -> list[Perception]:
    """Only a patch with a new frame has changed contacts, as on a robot."""
    made, onsets = [], dict[int, float]()
    stamp, sequence = np.zeros(2), np.zeros(2, np.int64)
    now: dict[int, float] = {}
    frame: Contacts | None = None
    for step, (fresh, forces) in enumerate(steps):
        for patch in (0, 1):
            if fresh[patch]:
                stamp[patch], sequence[patch] = DT * step, step + 1
                now = {n: f for n, f in now.items() if n % 2 != patch}
                now |= {n: f for n, f in forces.items() if n % 2 == patch}
        if frame is None or any(fresh):
            rows = np.zeros(len(now), CONTACT)
            onsets = {n: onsets.get(n, DT * step) for n in now}
            for row, (identity, force) in zip(rows, now.items(), strict=True):
                row["identity"], row["force"], row["site"] = identity, force, identity % 2
                row["onset"], row["p_L"] = onsets[identity], [force, step, identity]
            begin = np.zeros(len(now) + 1, np.int64)
            frame = Contacts(SITES, stamp.copy(), sequence.copy(), rows, begin, np.zeros(0, TAXEL))
        made.append(Perception(DT * step, {}, frame))
    return made


def added(seen: Sequence[Perception], history: ContactHistory) -> ContactHistory:
    for one in seen:
        history = history.add(one)
    return history


@given(FELT, st.integers(1, 12), st.integers(1, 30))
def test_it_says_what_the_frames_of_the_last_seconds_say(
    steps: list[Felt], capacity: int, periods: int
) -> None:
    seen = perceptions(steps)
    history = added(seen, ContactHistory(span=DT * (periods + 0.5), capacity=capacity))
    frames = [
        (one.stamp, one.contacts)
        for n, one in enumerate(seen)
        if not n or one.contacts is not seen[n - 1].contacts
    ]
    last = frames[-1][0] if frames else 0.0
    begin = last - DT * (periods + 0.25)
    kept = [frame for stamp, frame in frames if len(frame) and stamp >= begin][-capacity:]
    assert [*history.frames] == kept
    rows = {}
    for contact in (contact for frame in kept for contact in frame):
        rows.setdefault(contact.identity, {}).setdefault(contact.stamp, contact)
    assert {*history.identities} == {*rows}
    present = {contact.identity for contact in frames[-1][1]} if frames else set()
    for path in history.paths:
        mine = rows[path.identity]
        assert path.stamp.tolist() == [*mine]
        assert path.force.tolist() == [contact.force for contact in mine.values()]
        assert path.p_L.tolist() == [contact.p_L.tolist() for contact in mine.values()]
        first = next(iter(mine.values()))
        assert (path.site.patch, path.onset) == (first.patch, first.onset)
        assert path.duration == pytest.approx(max(mine) - first.onset)
        assert path.ended is (path.identity not in present)
    assert [path.identity for path in history.ended] == [i for i in history.identities if i not in present]
    onsets = [path.onset for path in history.paths]
    assert onsets == sorted(onsets)


@given(FELT)
def test_the_same_frame_twice_changes_nothing(steps: list[Felt]) -> None:
    history = ContactHistory(span=0.2)
    for one in perceptions(steps):
        after = history.add(one)
        again = Perception(one.stamp + 0.5 * DT, {}, pickle.loads(pickle.dumps(one.contacts)))
        assert after.add(one) is after
        assert after.add(again) is after, "also a copy of the frame, and later"
        history = after


@given(FELT, FELT)
def test_it_is_a_value(first: list[Felt], more: list[Felt]) -> None:
    seen = perceptions([*first, *more])
    history = added(seen[: len(first)], ContactHistory())
    before = [(path.identity, path.ended, path.rows.tobytes()) for path in history.paths]
    one = added(seen[len(first) :], history)
    other = added(seen[len(first) :], pickle.loads(pickle.dumps(history)))
    assert [(path.identity, path.ended, path.rows.tobytes()) for path in history.paths] == before
    assert [p.rows.tobytes() for p in one.paths] == [p.rows.tobytes() for p in other.paths]
    assert {*map(id, one.frames)} <= {id(perception.contacts) for perception in seen}, "frames are shared"


def test_a_clock_that_went_back_begins_a_new_history() -> None:
    early, late = perceptions([Felt((True, True), {1: 1.0}), Felt((True, True), {2: 1.0})])
    assert ContactHistory().add(late).add(early).identities == (1,)


def test_what_is_wrong_is_told_with_what_is_valid() -> None:
    with pytest.raises(TciError, match=r"span 0\.0 s; valid: above 0"):
        ContactHistory(span=0.0)
    with pytest.raises(TciError, match="capacity 0; valid: 1 or more"):
        ContactHistory(capacity=0)
    (seen,) = perceptions([Felt((True, True), {3: 1.0})])
    with pytest.raises(TciError, match="no contact 7 in the history; valid: 3"):
        ContactHistory().add(seen).path(7)
    with pytest.raises(TciError, match="valid: none yet"):
        ContactHistory().path(7)


def test_two_taps_on_a_robot_are_two_short_contacts() -> None:
    robot, history = TouchedRobot("nao"), ContactHistory()
    for touch in ["left_forearm"] * 3 + [None] * 20 + ["left_forearm"] * 3 + [None] * 20:
        history = history.add(robot.perceive(touch, force=4.0))
    first, second = history.ended
    assert first.site.part == second.site.part == "left_arm"
    assert first.onset + first.duration < second.onset
    assert max(first.duration, second.duration) < 0.2
    assert first.force.max() > 1.0
    assert not set(history.identities) - {first.identity, second.identity}
