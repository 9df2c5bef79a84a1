"""A withdrawal that would move towards a touch is refused. An object in the path of a withdrawal ends the
withdrawal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from helpers.touches import BODY, POSTURE, body_that, one_field, poke, see
from tci.body.generic_body import GenericBody
from tci.capabilities.soft_reaction import SoftReaction
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages import Contact, Contacts, Mode, Perception
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.testing import perception

FIELD = one_field()
REFLEX = WithdrawalReflex(fields=(FIELD,), response="meant")
SKIN = perception("nao").skin


@dataclass(frozen=True)
class Room:
    """Displacement [m] of each contact away from the object and along the object's surface, for any motion,
    by the contact's identity, and depth [m] by which other skin enters the object."""

    away: Mapping[int, Sequence[float]]
    across: float = 0.0
    entered: float = 0.0

    def retreat(self, perception: Perception, part: str, target: Array, mode: Mode, *, driven: bool) -> Array:
        """Replaces `GenericBody.retreat`."""
        inwards = np.array([self.away[contact.identity] for contact in perception.contacts]).T
        across, entered = np.full_like(inwards, self.across), np.full_like(inwards, self.entered)
        return np.stack([inwards, across, entered])


def touches(*identities: int, force: float = 5.0) -> list[Contact]:
    """Returns contacts at the centre of the field."""
    return [poke(FIELD, force).table.changed(identity=one)[0] for one in identities]


def seen(
    room: Room, *contacts: Contact, stamp: float = 0.0, posture: Array = POSTURE
) -> tuple[Perception, GenericBody]:
    """Returns the perception of the contacts, and a body whose `retreat` is that of `room`."""
    return see(*contacts, stamp=stamp, posture={"left_arm": posture}), body_that(retreat=room.retreat)


def test_a_motion_into_the_touch_is_refused_and_told() -> None:
    for away, told in (
        ((-0.001, 0.02), "press left_arm_forearm 1 mm into the object that touches it"),
        ((0.001, -0.02), "press left_arm_forearm 20 mm"),
        (
            (0.0, 0.0001),
            "would take left_arm_forearm 0.1 mm away from the object that touches it; valid: 1 mm or more",
        ),
    ):
        commands, memory = REFLEX.step(REFLEX.init(BODY), *seen(Room({1: away}), *touches(1)))
        assert commands == ()
        assert not memory
        (note,) = REFLEX.notes(memory)
        assert note.startswith("left_arm was touched and does not move: its motion would")
        assert told in note
    commands, memory = REFLEX.step(REFLEX.init(BODY), *seen(Room({1: (0.001, 0.02)}), *touches(1)))
    assert len(commands) == 1
    assert not REFLEX.notes(memory)


def test_a_motion_along_the_skin_is_no_withdrawal() -> None:
    for across, given in ((0.09, True), (0.11, False)):
        room = Room({1: (0.02, 0.02)}, across)
        commands, memory = REFLEX.step(REFLEX.init(BODY), *seen(room, *touches(1)))
        assert bool(commands) is given
        assert ("drag left_arm_forearm" in "".join(REFLEX.notes(memory))) is not given


def test_a_motion_that_brings_other_skin_into_the_object_is_refused_and_told() -> None:
    for entered, given in ((0.00009, True), (0.00011, False)):
        room = Room({1: (0.02, 0.02)}, entered=entered)
        commands, memory = REFLEX.step(REFLEX.init(BODY), *seen(room, *touches(1)))
        assert bool(commands) is given
        told = "would press other skin 0.11 mm into the object that touches left_arm_forearm"
        assert (told in "".join(REFLEX.notes(memory))) is not given


def test_of_two_touches_at_opposite_sides_none_is_answered() -> None:
    commands, memory = REFLEX.step(
        REFLEX.init(BODY), *seen(Room({1: (0.001, 0.02), 2: (-0.001, -0.02)}), *touches(1, 2))
    )
    assert commands == ()
    assert "press" in memory.refused["left_arm"].reason


def test_many_touches_of_one_field_take_one_look() -> None:
    room, looks = Room(dict.fromkeys(range(30), (-0.01,))), []

    def counted(perception: Perception, part: str, target: Array, mode: Mode, *, driven: bool) -> Array:
        looks.append(part)
        return room.retreat(perception, part, target, mode, driven=driven)

    view, _ = seen(room, *touches(*range(30)))
    commands, memory = REFLEX.step(REFLEX.init(BODY), view, body_that(retreat=counted))
    assert commands == ()
    assert "press" in memory.refused["left_arm"].reason
    assert len(looks) == 1


def test_a_touch_that_lasts_is_judged_anew_when_the_skin_tells_something_new_or_after_a_while() -> None:
    room, looks = Room({1: (-0.01,)}), []

    def counted(perception: Perception, part: str, target: Array, mode: Mode, *, driven: bool) -> Array:
        looks.append(part)
        return room.retreat(perception, part, target, mode, driven=driven)

    body = body_that(retreat=counted)
    frames, memory, when = [Contacts.of(touches(1)), Contacts.of(touches(1))], REFLEX.init(BODY), []
    for tick in range(60):
        view = see(stamp=tick / 1024, posture={"left_arm": POSTURE})
        skin = replace(SKIN, sequence=np.array([int(tick >= 5)]))
        view = replace(view, contacts=frames[tick >= 5], skin=skin)
        before = len(looks)
        commands, memory = REFLEX.step(memory, view, body)
        when += [tick] * (len(looks) - before)
        assert commands == ()
        assert "press" in memory.refused["left_arm"].reason
    assert when == [0, 5, 26, 47]


def test_a_refused_touch_is_not_judged_anew_while_neither_touch_nor_joints_change() -> None:
    room, looks = Room({1: (-0.01,)}), []

    def counted(perception: Perception, part: str, target: Array, mode: Mode, *, driven: bool) -> Array:
        looks.append(part)
        return room.retreat(perception, part, target, mode, driven=driven)

    body, memory, when = body_that(retreat=counted), REFLEX.init(BODY), []
    joints = perception("nao").joints
    assert joints is not None
    for tick in range(50):
        moved = replace(joints, position=joints.position + (1e-9 if tick >= 20 else 0.0))
        contacts = Contacts.of(touches(1, force=5.0 if tick < 10 else 6.0))
        view = replace(see(stamp=0.1 * tick, posture={"left_arm": POSTURE}), contacts=contacts, joints=moved)
        skin = replace(SKIN, sequence=np.array([tick]))
        before = len(looks)
        _, memory = REFLEX.step(memory, replace(view, skin=skin), body)
        when += [tick] * (len(looks) - before)
        assert "press" in memory.refused["left_arm"].reason
    assert when == [0, 10, 20]


def test_of_several_touches_one_must_get_away() -> None:
    for away, given in ((0.02, True), (0.0, False)):
        hard, light = *touches(1), *touches(2, force=2.0)
        view = seen(Room({1: (0.0,), 2: (away,)}), hard, light)
        commands, _ = REFLEX.step(REFLEX.init(BODY), *view)
        assert bool(commands) is given


def test_a_touch_that_flickers_for_long_is_not_remembered_for_long() -> None:
    memory = REFLEX.init(BODY)
    for one in range(300):
        view = seen(Room({one: (0.01,)}), *touches(one), stamp=0.01 * one)
        _, memory = REFLEX.step(memory, *view)
    assert len(memory["left_arm"].met) == 1


def test_a_withdrawal_ends_where_it_meets_something_and_stays_there_until_nothing_touches() -> None:
    free, blocked = Room({1: (0.01, 0.02)}), Room({1: (0.01, 0.02), 2: (-0.01, -0.02)})
    memory, sent = REFLEX.init(BODY), []
    for tick, (room, contacts) in enumerate(
        [(free, touches(1))] * 2 + [(blocked, touches(1, 2))] * 3 + [(free, touches(1, force=2.0))] * 3
    ):
        here = POSTURE + 0.01 * tick
        commands, memory = REFLEX.step(memory, *seen(room, *contacts, stamp=0.01 * tick, posture=here))
        sent += [(tick, command.values) for command in commands]
    assert [tick for tick, _ in sent] == [0, 2]
    np.testing.assert_allclose(sent[1][1], POSTURE + 0.02)
    assert "left_arm was touched and does not move" in REFLEX.notes(memory)[0]
    for stamp in (1.0, 2.0):
        commands, memory = REFLEX.step(memory, *seen(free, stamp=stamp))
        assert not commands
    assert not memory
    again, memory = REFLEX.step(memory, *seen(free, *touches(1), stamp=3.0))
    assert len(again) == 1
    assert not REFLEX.notes(memory)


def test_in_velocity_mode_an_ended_withdrawal_drives_no_further() -> None:
    reflex = replace(REFLEX, mode=Mode.VELOCITY)
    free, blocked = Room({1: (0.01, 0.02)}), Room({1: (0.01, 0.02), 2: (-0.01, -0.02)})
    _, memory = reflex.step(reflex.init(BODY), *seen(free, *touches(1)))
    ((command,), memory) = reflex.step(memory, *seen(blocked, *touches(1, 2), stamp=0.01))
    assert not command.values.any()


def test_a_withdrawal_does_not_grow_into_a_touch() -> None:
    free, blocked = Room({1: (0.01, 0.02)}), Room({1: (0.01, -0.02)})
    first, memory = REFLEX.step(REFLEX.init(BODY), *seen(free, *touches(1, force=2.0)))
    more, after = REFLEX.step(memory, *seen(blocked, *touches(1), stamp=0.01))
    assert len(first) == 1
    assert not more
    assert after["left_arm"].gain == memory["left_arm"].gain
    assert REFLEX.notes(after)


def test_a_refused_growth_is_told_in_a_period_that_brings_a_new_contact_too() -> None:
    _, memory = REFLEX.step(REFLEX.init(BODY), *seen(Room({1: (0.01, 0.02)}), *touches(1, force=2.0)))
    far = np.abs(memory["left_arm"].target - POSTURE).max() + 1e-6

    class Wall(Room):
        def retreat(
            self, perception: Perception, part: str, target: Array, mode: Mode, *, driven: bool
        ) -> Array:
            room = Room(
                {one: (0.01, -0.02 if np.abs(target - POSTURE).max() > far else 0.02) for one in (1, 2)}
            )
            return room.retreat(perception, part, target, mode, driven=driven)

    _, after = REFLEX.step(memory, *seen(Wall({}), *touches(1, 2), stamp=0.01))
    assert after["left_arm"].gain == memory["left_arm"].gain
    assert after["left_arm"].met == {1, 2}
    assert REFLEX.notes(after)


def test_a_soft_arm_between_two_touches_stays_and_says_so() -> None:
    jacobian = np.eye(3, 5)
    for mode in (Mode.VELOCITY, Mode.TORQUE):
        reaction = SoftReaction(parts=("left_arm",), mode=mode)
        for room, moves in ((Room({1: (0.01,), 2: (0.01,)}), True), (Room({1: (0.01,), 2: (-0.01,)}), False)):
            view, _ = seen(room, *touches(1, 2))
            body = body_that(retreat=room.retreat, jacobian=lambda perception, contact: jacobian)
            ((command,), memory) = reaction.step({}, view, body)
            assert bool(command.values.any()) is moves
            assert bool(reaction.notes(memory)) is not moves


def test_only_a_velocity_that_is_commanded_anew_in_each_period_is_judged_for_a_short_time() -> None:
    """A withdrawal in velocity mode lasts until its target, so its whole path is judged. In an earlier
    version only the first 0.1 s were judged in this mode: 12 of 30 degrees for an iCub."""
    seen = perception("icub", "left_forearm")
    body = GenericBody(load_robot("icub"))
    target = np.array(seen.posture["left_arm"]) + np.deg2rad([-30.0, 20.0, 0.0, 0.0, 0.0])
    whole = body.retreat(seen, "left_arm", target, Mode.POSITION)[:, -1]
    np.testing.assert_allclose(body.retreat(seen, "left_arm", target, Mode.VELOCITY)[:, -1], whole, atol=1e-6)
    near = body.retreat(seen, "left_arm", target, Mode.VELOCITY, driven=True)[:, -1]
    assert np.linalg.norm(near) < 0.7 * np.linalg.norm(whole)
