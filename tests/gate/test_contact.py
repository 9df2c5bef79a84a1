"""A part that meets somebody goes back, frees them without help, and obeys nobody meanwhile.

The judge is a plant of rigid bodies that shares nothing with the gate (`helpers.rigid_robot`).
"""

from __future__ import annotations

import ast
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

from helpers import HELPERS
from helpers.gate_checks import PERIOD, make_robot, position_command, reading
from helpers.rigid_robot import RigidDriver, RigidRobot
from helpers.squeezed import squeeze
from helpers.squeezes import draw
from tci.body.generic_body import GenericBody, order_to_platform
from tci.capabilities.capability import Capability
from tci.errors import CommandError, TciError, UnknownNameError
from tci.gate.contact import reaction
from tci.gate.contact.settings import ContactSettings
from tci.gate.contact.streams import Stream
from tci.gate.contact.weights import bends
from tci.gate.gate import Gate, GateSettings, GateState
from tci.gate.joint_monitor import Reference
from tci.gate.settings import OVER_A_WIRE
from tci.messages import (
    Contacts,
    ExpectContact,
    GenericCommand,
    Mode,
    Order,
    Perception,
    PlatformCommand,
    PlatformOrder,
    PlatformSwitch,
)
from tci.messages.contacts import CONTACT, TAXEL, Site
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.catalogue import load_robot
from tci.robot.joint_calibration import Tool
from tci.runtime.loop import run

ZERO, ONE = [0.0] * 6, np.ones(1)
ALONE = GateSettings(contact=None)
ANSWERS = GateSettings(contact=ContactSettings())
STIFF = GateSettings(contact=ContactSettings(softens=False))
"""For servos that take no share of their stiffness."""


class Held:
    """Joints that follow at once, of which one can't pass an angle and pushes back from there."""

    def __init__(self, *, at: float = 0.5, settings: GateSettings = ANSWERS) -> None:
        self.gate = Gate(make_robot(), period=PERIOD, stale_after=0.05, settings=settings, streams=True)
        self.angles, self.at, self.now = np.zeros(6), at, 0.0
        self.behind = -np.inf
        self.hand = np.zeros(6)
        """How far [rad] somebody, or gravity, bends each joint."""
        self.told: list[str] = []
        self.refused: list[Code] = []

    def step(self, *orders: PlatformOrder, contacts: Contacts | None = None, stale: float = 0.0) -> Array:
        """`stale` is the age [s] of the joint data."""
        seen = reading(self.angles, self.now - stale)
        safe = self.gate.step(orders, seen, self.now, contacts=contacts)
        self.safe = safe
        self.angles[safe.servos] = safe.position + self.hand[safe.servos]
        self.angles[2] = np.clip(self.angles[2], self.behind, self.at)
        self.told += [one.text for one in safe.clamped if one.code is Code.CONTACT]
        self.refused += [one.code for one in safe.refusals]
        self.now += PERIOD
        self.sent = dict(zip(safe.servos.tolist(), safe.position.tolist(), strict=True))
        return safe.position


def pressed(*forces: float) -> Contacts:
    """Contacts on the skin of the arm."""
    rows = np.zeros(len(forces), CONTACT)
    rows["identity"], rows["force"] = 7 + np.arange(len(forces)), forces
    site = Site("skin", "left_arm", "forearm")
    begin = np.zeros(len(forces) + 1, np.int64)
    return Contacts((site,), np.zeros(1), np.zeros(1, np.int64), rows, begin, np.zeros(0, TAXEL))


def expect(force: float) -> PlatformCommand:
    return order_to_platform(make_robot(), ExpectContact("left_arm", force), np.zeros(6))  # type: ignore[return-value]


def test_a_held_joint_goes_back_and_is_told() -> None:
    held = Held()
    held.step(position_command([2], [1.5]))
    for _ in range(800):
        held.step()
    assert held.told
    assert "joint2 is held" in held.told[0]
    assert held.sent[2] < held.at - np.deg2rad(2.0), "nothing presses"
    assert held.gate.state is GateState.RUN


def test_a_joint_that_a_weight_bends_hides_no_other_that_is_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is judged by its own bound: here 2.9 of 3.9 degrees, and 2.2 of 2."""
    monkeypatch.setattr(reaction, "bends", lambda *_: np.deg2rad([0.0, 2.6, 0.0, 0.0, 0.0, 0.0]))
    meets = reaction.ContactReaction(make_robot(), [0] * 6, ContactSettings(stands=False))
    told, own = list[Reason](), np.arange(6)
    for step in range(60):
        now, rates = step * PERIOD, np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0])
        angles = rates * max(now - ContactSettings().lag, 0.0) - np.deg2rad([0.0, 2.9, 2.2, 0.0, 0.0, 0.0])
        asked = Reference(own, (Mode.POSITION,) * 6, now * rates, rates, np.zeros(6))
        told += meets.step(reading(angles, now), asked, now, None)[1]
    assert "joint2 is held 2.2 degrees behind" in told[0].text


def test_an_arm_that_carries_a_weight_does_not_sink_after_a_contact(monkeypatch: pytest.MonkeyPatch) -> None:
    """It sank by 49 degrees. After two ways back it is known for a weight."""
    monkeypatch.setattr(reaction, "bends", lambda *_: np.deg2rad([0.0, 3.4, 0.0, 0.0, 0.0, 0.0]))
    held = Held()
    held.step(position_command([1], [0.0]))
    for step in range(2500):
        held.hand[1] = -np.deg2rad(min(0.02 * step, 3.0))
        held.step(*[position_command([2], [1.5])] * (step == 300))
    assert held.told
    assert held.angles[1] > -np.deg2rad(9.1)
    held.step(position_command([2], [0.2]))
    assert not held.refused, "the contact is over"


def test_what_hands_carry_bends_the_waist_too() -> None:
    """A G1 with 0.5 kg in its left hand, whose waist turned at full speed, met "something" at the waist."""
    robot = load_robot("g1")
    roll = next(servo.index for servo in robot.servos if servo.name == "waist_roll_joint")
    loads = {"left_wrist_yaw_link": Tool(mass=0.5, centre=(0.0, 0.0, 0.0))}
    bare, loaded = (np.rad2deg(bends(robot, one)[roll]) for one in ({}, loads))
    assert 0.9 < bare < 1.6, "0.3 kg at 0.4 to 0.9 m of 35 N m, and friction"
    assert bare + 0.5 < loaded < 4.0


def test_a_person_who_bends_a_joint_as_a_weight_might_is_freed_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Somebody as stiff as the servo."""
    monkeypatch.setattr(reaction, "bends", lambda *_: np.deg2rad([0.0, 3.4, 0.0, 0.0, 0.0, 0.0]))
    held = Held()
    held.step(position_command([1], [0.0]))
    for step in range(2500):
        pressed = np.deg2rad(min(6.0, 0.02 * step)) + held.sent.get(1, 0.0) if step else 0.0
        held.hand[1] = -0.5 * max(pressed, 0.0)
        held.step(*[position_command([2], [1.5])] * (step == 300))
    assert held.told
    assert -held.hand[1] < np.deg2rad(0.7)


def test_where_no_path_is_left_the_reference_goes_beyond_the_joint_so_that_nothing_presses_at_once() -> None:
    """Somebody as stiff as the servo bears half of what it is bent by. A reference that goes only to where
    the joint is leaves half of that each time."""
    held = Held(at=10.0, settings=GateSettings(contact=ContactSettings(answers={"left_arm": "soft"})))
    held.step(position_command([2], [1.5]))
    forces, told = [], []
    for _ in range(600):
        held.hand[2] = -0.5 * max(held.sent.get(2, 0.0) - 0.5, 0.0)
        held.step()
        forces.append(-held.hand[2])
        told.append(bool(held.told))
    noticed = told.index(True)
    assert forces[noticed] > np.deg2rad(1.0)
    assert max(forces[noticed + round(0.5 / PERIOD) :]) < 1e-6


def test_a_way_back_ends_where_skin_began_to_feel_not_where_the_arm_was_long_before() -> None:
    """So it strikes others who stand behind it less, and later."""
    held, fastest = Held(), 0.0
    held.step(position_command([2], [1.5]))
    while not held.told:
        fastest = max(fastest, float(held.safe.velocity[0]))
        held.step(contacts=pressed(30.0) if held.angles[2] > 0.48 else None)
    for _ in range(400):
        held.step()
    assert held.at - held.sent[2] > np.deg2rad(2.5), "somebody 5 mm deep is free"
    assert held.at - held.sent[2] < 0.08 * fastest + np.deg2rad(3.5)


def test_after_a_long_light_touch_it_does_not_go_back_all_its_way() -> None:
    """Skin feels 8 N for two seconds, in which the arm goes on, and then 30 N."""
    held, here = Held(at=9.0), 0.0
    held.step(position_command([2], [3.0], speed=0.5))
    for step in range(500):
        held.step(contacts=pressed(30.0) if 340 < step < 350 else pressed(8.0) if 150 < step < 350 else None)
        here = max(here, held.angles[2])
    assert "30 N on its skin" in held.told[0]
    assert np.deg2rad(3.0) < here - held.sent[2] < np.deg2rad(8.0)


def test_a_joint_that_its_way_back_pressed_against_somebody_else_is_not_thrown_at_the_first() -> None:
    held = Held()
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    held.behind = held.at - np.deg2rad(1.5)
    sent = [held.step()[0] for _ in range(1000)]
    assert min(sent) < held.behind - np.deg2rad(1.0), "its reference ran on"
    after = np.array(sent[int(np.argmin(sent)) :])
    assert after.max() < held.at, "the first is pressed again"
    assert np.abs(after[round(0.3 / PERIOD) :] - held.behind).max() < np.deg2rad(0.5)


def test_a_part_that_meets_somebody_in_its_first_moment_goes_back_with_all_its_joints() -> None:
    """For as long as joints may lag, 0.3 s over a wire, it pushed on: its references were not old enough."""
    held = Held(at=9.0, settings=OVER_A_WIRE)
    held.step(position_command([1, 2], [1.5, 1.5]), contacts=pressed())
    for _ in range(14):
        held.step(contacts=pressed())
    for _ in range(25):
        held.step(contacts=pressed(40.0))
    assert held.told
    there = held.angles[[1, 2]].copy()
    for _ in range(25):
        held.step(contacts=pressed(40.0))
    assert (held.angles[[1, 2]] < there).all() or (held.angles[[1, 2]] < 0.02).all()


def test_without_the_answer_it_presses_for_ever() -> None:
    held = Held(settings=ALONE)
    held.step(position_command([2], [1.5]))
    for _ in range(800):
        held.step()
    assert held.sent[2] > held.at + np.deg2rad(6.0)


def test_nobody_else_moves_the_part_until_the_contact_is_over() -> None:
    held = Held()
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    held.step(position_command([2], [1.5]))
    assert held.refused == [Code.CONTACT]
    for _ in range(1200):
        held.step()
    held.step(position_command([2], [0.2]))
    assert held.refused == [Code.CONTACT]
    for _ in range(800):
        held.step()
    assert held.sent[2] == pytest.approx(0.2)


def test_a_behaviour_that_insists_is_stopped_and_the_joint_freed() -> None:
    held = Held()
    for step in range(3000):
        held.step(*[position_command([2], [1.5])] * (step % 150 == 0))
    assert held.gate.state is GateState.STOP
    assert held.gate.reason is not None
    assert held.gate.reason.code is Code.CONTACT
    assert held.sent[2] < held.at


def test_a_stream_that_a_contact_interrupts_goes_on_only_near_the_part() -> None:
    """It struck the same person again half a second after the contact, and once more, until the gate
    stopped."""
    held, named = Held(), set[str]()
    for _ in range(2500):
        held.step(position_command([2], [1.5]))
        named |= {why.text.partition(" met")[0] for why in held.safe.refusals}
        assert held.gate.state is GateState.RUN, held.gate.reason
    assert named == {"left_arm"}, "not the robot's own name"
    assert len(held.told) == 1
    assert held.sent[2] < held.at
    assert held.safe.refusals[0].code is Code.CONTACT
    held.step(position_command([2], [held.sent[2] - np.deg2rad(4.0)]))
    assert not held.safe.refusals
    for _ in range(1000):
        held.step(position_command([2], [-0.2]))
        assert not held.safe.refusals
    assert held.sent[2] == pytest.approx(-0.2)


def test_a_joint_that_is_where_its_stream_asks_lets_no_other_joint_go_on() -> None:
    held = Held()
    for _ in range(2500):
        held.step(position_command([2], [1.5]), position_command([3], [0.0]))
    assert len(held.told) == 1
    assert len(held.safe.refusals) == 1
    assert held.sent[2] < held.at


def test_a_stream_bears_a_clock_that_stands_at_minus_infinity() -> None:
    stream, order = Stream(np.arange(3)), position_command([2], [1.5])
    with np.errstate(invalid="raise"):
        for now in np.full(2, -np.inf):
            assert stream.refuses(make_robot(), order, np.zeros(6), now, blocked=True, handled=False)


def test_a_stream_that_a_contact_interrupts_begins_anew_after_a_pause() -> None:
    held = Held()
    for _ in range(1200):
        held.step(position_command([2], [1.5]))
    for _ in range(150):
        held.step()
    held.step(position_command([2], [-0.5]))
    assert not held.safe.refusals


@pytest.mark.parametrize("stops", [False, True])
def test_a_stream_that_a_contact_interrupts_does_not_go_on_after_a_reset(stops: bool) -> None:
    held = Held()
    for step in range(2500):
        held.step(position_command([2], [1.5]))
        if held.told and stops:
            held.gate.stop("another cause")
        if step == 1500:
            held.gate.reset()
            stops = False
    assert held.gate.state is GateState.RUN
    assert len(held.told) == 1


def streamed(held: Held, periods: int, *velocities: float) -> None:
    """Velocities [rad/s] of joints 2 and 3, one each period."""
    for _ in range(periods):
        held.step(replace(position_command([2, 3], velocities), mode=Mode.VELOCITY))


def in_velocity_mode() -> Held:
    held, robot = Held(), make_robot(modes=(Mode.POSITION, Mode.VELOCITY))
    held.gate = Gate(robot, period=PERIOD, stale_after=0.05, settings=ANSWERS, streams=True)
    held.step(PlatformSwitch(np.array([2, 3]), Mode.VELOCITY))
    return held


def test_a_stream_of_velocities_that_a_contact_interrupts_does_not_go_on() -> None:
    """It struck the same person three times, until the gate stopped."""
    held = in_velocity_mode()
    streamed(held, 2500, 1.0, 0.0)
    assert held.gate.state is GateState.RUN, held.gate.reason
    assert len(held.told) == 1
    assert held.sent[2] < held.at
    streamed(held, 1, 0.5, 1.0)
    assert "valid: velocities of 0, or back" in held.safe.refusals[0].text
    streamed(held, 1, -0.5, 1.0)
    assert not held.safe.refusals


@pytest.mark.parametrize("between", ["rests", "pauses"])
def test_a_stream_of_velocities_goes_on_after_it_rested(between: str) -> None:
    held = in_velocity_mode()
    streamed(held, 1200, 1.0, 0.0)
    streamed(held, 1, 0.0, 0.0) if between == "rests" else [held.step() for _ in range(150)]
    streamed(held, 50, 0.3, 0.0)
    assert not held.safe.refusals
    assert held.safe.velocity[0] > 0.0


def test_a_capability_that_handles_contact_goes_on_after_one() -> None:
    held = in_velocity_mode()
    for _ in range(600):
        held.step(expect(30.0))
        streamed(held, 1, 1.0, 0.0)
    assert len(held.told) > 1


def test_reset_moves_nothing_and_waits_for_the_contact_to_end() -> None:
    held = Held()
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    held.gate.stop("an operator's button")
    for _ in range(20):
        held.step()
    with pytest.raises(CommandError, match=r"in contact|at rest"):
        held.gate.reset()
    for _ in range(1200):
        held.step()
    assert held.sent[2] < held.at, "freed although the gate had stopped for another cause"
    held.gate.reset()


def test_after_a_stop_that_knows_no_way_back_the_part_rests_and_can_be_reset() -> None:
    held = Held()
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    held.gate.stop(Reason(Code.ENCODER_FROZEN, "an encoder stands still"))
    for _ in range(300):
        held.step()
    held.gate.reset()
    for _ in range(300):
        held.step(position_command([2], [0.2]))
    assert held.sent[2] == pytest.approx(0.2)


def test_a_way_back_does_not_go_on_without_joint_data() -> None:
    held = Held()
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    while held.safe.velocity[0] >= 0.0:
        held.step()
    goal, begun = held.gate.targets[0], held.sent[2]
    for _ in range(300):
        held.step(stale=1.0)
    assert held.gate.state is GateState.HOLD
    assert held.sent[2] < begun, "it was on its way"
    assert held.sent[2] > goal + np.deg2rad(1.0)


def test_a_switch_that_waits_for_rest_does_not_come_after_a_contact() -> None:
    robot = make_robot(modes=(Mode.POSITION, Mode.VELOCITY))
    held = Held()
    held.gate = Gate(robot, period=PERIOD, stale_after=0.05, settings=ANSWERS)
    held.step(position_command([2], [1.5]))
    while held.angles[2] < held.at:
        held.step()
    held.step(PlatformSwitch(np.array([2]), Mode.VELOCITY))
    for _ in range(1200):
        held.step()
    assert held.told
    assert held.gate.modes[2] is Mode.POSITION


def test_a_way_back_never_leads_nearer() -> None:
    """Somebody came behind an arm that turned back after 3 degrees."""
    held = Held(at=10.0)
    held.angles[2] = 1.0
    held.step(position_command([2], [1.0]))
    for _ in range(50):
        held.step()
    held.step(position_command([2], [0.95]))
    for _ in range(200):
        held.step()
    held.at = 0.96
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    assert held.gate.targets[0] < held.at


def test_skin_that_is_unknown_for_one_reading_does_not_end_a_contact() -> None:
    held, felt = Held(at=10.0), pressed(20.0)
    held.step(position_command([2], [1.5]))
    for _ in range(100):
        held.step()
    for _ in range(1000):
        held.step(contacts=felt)
    assert held.told
    held.step()
    for _ in range(500):
        held.step(contacts=felt)
    held.step(position_command([2], [1.5]), contacts=felt)
    assert held.refused == [Code.CONTACT]


@pytest.mark.parametrize(("force", "answers"), [(20.0, False), (40.0, True)])
def test_contact_that_a_capability_expects_is_left_to_it_up_to_its_force(force: float, answers: bool) -> None:
    held = Held(at=10.0)
    held.step(position_command([2], [1.5]))
    for count in range(200):
        held.step(expect(30.0), contacts=pressed(force) if count > 100 else None)
    assert bool(held.told) is answers
    assert held.safe.met[0].answer == ("retreat" if answers else "expected")


def test_a_held_joint_is_left_to_the_capability_only_if_skin_feels_how_hard() -> None:
    for contacts, answers in ((pressed(12.0), False), (None, True)):
        held = Held()
        held.step(position_command([2], [1.5]))
        for _ in range(600):
            held.step(expect(30.0), contacts=contacts)
        assert bool(held.told) is answers


def test_an_expectation_expires() -> None:
    held = Held(at=10.0)
    held.step(position_command([2], [1.5]), expect(30.0))
    for _ in range(100):
        held.step()
    for _ in range(20):
        held.step(contacts=pressed(20.0))
    assert not held.told, "within half a second"
    held = Held(at=10.0)
    held.step(expect(30.0))
    for _ in range(300):
        held.step()
    held.step(position_command([2], [1.5]))
    for _ in range(50):
        held.step()
    for _ in range(20):
        held.step(contacts=pressed(20.0))
    assert held.told


@pytest.mark.parametrize("force", [-1.0, 66.0, np.nan])
def test_an_impossible_expectation_is_refused(force: float) -> None:
    with pytest.raises(CommandError, match="valid: 0 to 65 N"):
        ExpectContact("left_arm", force)
    held = Held()
    held.step(replace(expect(1.0), values=np.full(5, force)))
    assert held.refused


def test_a_resting_arm_that_is_pressed_gives_way_and_still_obeys() -> None:
    held = Held(at=10.0)
    held.step(position_command([2], [0.5]))
    for _ in range(1200):
        held.step()
    for _ in range(400):
        held.hand[2] = min(held.hand[2] + np.deg2rad(0.02), np.deg2rad(1.0))
        held.step(contacts=pressed(20.0))
    assert not held.told
    assert held.safe.met[0].answer == "soft"
    assert held.sent[2] > 0.5 + np.deg2rad(20.0), "it followed the hand"
    held.hand[:] = 0.0
    for _ in range(100):
        held.step()
    rests = held.sent[2]
    for _ in range(100):
        held.step()
    assert held.sent[2] == pytest.approx(rests), "and stays where it was left"
    for _ in range(10):
        held.step(contacts=pressed(20.0))
    held.step(position_command([2], [0.2]), contacts=pressed(20.0))
    for _ in range(1200):
        held.step(contacts=pressed(20.0))
    assert not held.refused
    assert held.sent[2] == pytest.approx(0.2)


def test_an_arm_of_stiff_servos_gives_way_to_whom_its_skin_feels() -> None:
    """A simulated iCub that 60 N pressed for two seconds was told to give way, and turned by 0.07 degrees."""
    held = Held(at=10.0)
    held.step(position_command([2], [0.5]))
    for _ in range(1200):
        held.step()
    held.hand[2] = np.deg2rad(0.05)
    for _ in range(400):
        held.step(contacts=pressed(20.0))
    assert held.sent[2] > 0.5 + np.deg2rad(5.0)


def test_an_arm_sags_no_further_when_it_gives_way() -> None:
    """A joint that gravity bends by a degree: its reference keeps that distance."""
    held = Held(at=10.0)
    held.hand[2] = -np.deg2rad(1.0)
    held.step(position_command([2], [0.5]))
    for _ in range(1200):
        held.step()
    for _ in range(1000):
        held.step(contacts=pressed(20.0))
    assert held.sent[2] == pytest.approx(0.5, abs=np.deg2rad(0.3))


def test_a_pat_is_told_and_answered_by_nobody() -> None:
    held = Held(at=10.0)
    held.step(position_command([2], [0.5]))
    for pulse in range(1200):
        held.step(contacts=pressed(12.0) if pulse % 100 < 30 else None)
    held.step(contacts=pressed(12.0))
    assert [(one.part, one.force, one.joint, one.answer) for one in held.safe.met] == [
        ("left_arm", 12.0, None, "told")
    ]
    assert held.gate.state is GateState.RUN
    assert not held.told


def test_a_joint_that_nobody_commands_tells_contact_by_how_it_is_bent() -> None:
    held = Held(at=10.0)
    for _ in range(10):
        held.step()
    held.step(position_command([2], [1.5]))
    for _ in range(100):
        held.step()
    assert not held.told
    for _ in range(4):
        held.angles[3] += np.deg2rad(1.0)
        held.step()
    began = held.angles[2]
    for _ in range(400):
        held.step()
    assert "joint3, which nobody commands, is bent by" in held.told[0]
    assert held.sent[2] < began - np.deg2rad(2.5)


@pytest.mark.parametrize("answer", ["soft", "stop"])
def test_a_part_may_give_way_or_stay_stiff_instead_of_going_back(answer: Literal["soft", "stop"]) -> None:
    held = Held(settings=GateSettings(contact=ContactSettings(answers={"left_arm": answer})))
    held.step(position_command([2], [1.5]))
    for _ in range(400):
        held.step()
    assert held.told
    assert not held.refused
    if answer == "soft":
        assert held.sent[2] == pytest.approx(held.at, abs=1e-6)
    else:
        assert held.at < held.sent[2] < held.at + np.deg2rad(10.0)
    with pytest.raises(UnknownNameError, match="tail"):
        Held(settings=GateSettings(contact=ContactSettings(answers={"tail": answer})))


@pytest.mark.parametrize(
    ("settings", "place"),
    [
        ({"answers": {"left_arm": "hug"}}, "left_arm answers by hug; valid: retreat, soft, stop"),
        ({"felt": np.nan}, "felt nan; valid: 1 to 65"),
        ({"felt": 1e9}, "felt 1000000000.0; valid: 1 to 65"),
        ({"held": 0.2}, "held 0.2; valid: 0.001 to 0.105"),
        ({"of_parts": {"head": (9.0, 5.0)}}, "head told 9.0, felt 5.0; valid: 0 <= told <= felt <= 65"),
    ],
)
def test_a_setting_that_would_hide_contact_is_refused(settings: dict[str, Any], place: str) -> None:
    """An unknown answer ended the loop at the first contact, and 1e9 N switched skin off in silence."""
    with pytest.raises(TciError, match=f"contact: {place}"):
        ContactSettings(**settings)


def test_settings_change_while_nothing_is_in_contact() -> None:
    held = Held(at=10.0)
    held.gate.set_contact(ContactSettings(felt=25.0))
    held.step(position_command([2], [1.5]))
    for count in range(200):
        held.step(contacts=pressed(20.0) if count > 100 else None)
    assert not held.told
    with pytest.raises(CommandError, match="valid: other settings when nothing presses"):
        held.gate.set_contact(ContactSettings())
    with pytest.raises(CommandError, match="valid: the gate that owns the robot"):
        Held(settings=ALONE).gate.set_contact(ContactSettings())


@pytest.mark.parametrize(
    ("thresholds", "answer"), [((5.0, 25.0), "told"), ((21.0, 25.0), None), ((5.0, 10.0), "retreat")]
)
def test_a_part_has_thresholds_of_its_own(thresholds: tuple[float, float], answer: str | None) -> None:
    held = Held(at=10.0, settings=GateSettings(contact=ContactSettings(of_parts={"left_arm": thresholds})))
    held.step(position_command([2], [1.5]))
    for count in range(200):
        held.step(contacts=pressed(20.0) if count > 100 else None)
    assert ([one.answer for one in held.safe.met] or [None]) == [answer]
    with pytest.raises(UnknownNameError, match="nose"):
        Held(settings=GateSettings(contact=ContactSettings(of_parts={"nose": (5.0, 15.0)})))


def test_an_operator_frees_what_a_part_that_stops_holds() -> None:
    held = Held(settings=GateSettings(contact=ContactSettings(answers={"left_arm": "stop"})))
    with pytest.raises(CommandError, match="nothing is in contact"):
        held.gate.free()
    held.step(position_command([2], [1.5]))
    for _ in range(400):
        held.step()
    held.gate.stop("an operator's button")
    held.step()
    before = held.sent[2]
    with pytest.raises(CommandError, match=r"gate.free\(\)"):
        held.gate.reset()
    assert held.sent[2] == before, "reset never moves"
    held.gate.free()
    fastest = 0.0
    for _ in range(1200):
        last = held.sent[2]
        held.step()
        fastest = max(fastest, abs(held.sent[2] - last) / PERIOD)
    assert held.sent[2] < held.at
    assert fastest <= np.deg2rad(10.01)
    assert held.gate.state is GateState.STOP
    held.gate.reset()


def test_a_way_back_from_one_contact_does_not_load_another_that_was_there_before() -> None:
    """A finger pokes the resting arm; on its way from the finger the arm meets a bystander at 0.6 rad."""
    held = Held(at=10.0)

    def skin() -> Contacts:
        angle = float(held.angles[2])
        return pressed(max(0.0, 6.0 + 400.0 * (0.55 - angle)), max(0.0, 400.0 * (angle - 0.6)))

    held.step(position_command([2], [0.5]))
    for _ in range(1200):
        held.step()
    for _ in range(20):
        held.step(contacts=skin())
    held.step(position_command([2], [1.5]), contacts=skin())
    for _ in range(1500):
        held.step(contacts=skin())
    assert held.told
    finger, bystander = (one.force for one in skin())
    assert bystander <= 15.0
    assert finger <= 30.0, "not back against the finger: it was 226 N"


def test_after_the_clock_went_back_a_contact_still_ends() -> None:
    held = Held()
    held.now = 100.0
    held.step(position_command([2], [1.5]))
    while not held.told:
        held.step()
    held.now = 0.0
    for _ in range(1000):
        held.step()
    assert held.gate.reason is not None
    assert held.gate.reason.code is Code.TIME_WENT_BACK
    held.gate.reset()


def test_a_resting_arm_that_is_pushed_by_hand_does_not_retreat_but_gives_way() -> None:
    """Its reference kept its place before, and after 6 degrees the gate stopped."""
    held = Held(at=10.0)
    held.step(position_command([2], [0.5]))
    for _ in range(1200):
        held.step()
    hand, safe = 0.5, held.safe
    for _ in range(1500):
        hand = min(hand + np.deg2rad(10.0) * PERIOD, 0.5 + np.deg2rad(25.0))
        before = safe.position[0]
        pushed = held.angles.copy()
        pushed[2] = max(before, 0.5 * (before + hand))  # a hand as stiff as the servo
        safe = held.gate.step((), reading(pushed, held.now), held.now)
        held.now += PERIOD
        assert not safe.clamped
        assert before - 1e-9 <= safe.position[0] <= hand
    assert held.gate.state is GateState.RUN, held.gate.reason
    assert safe.position[0] > hand - np.deg2rad(3.0)
    for _ in range(200):
        safe = held.gate.step((), reading(np.array([0, 0, safe.position[0], 0, 0, 0]), held.now), held.now)
        held.now += PERIOD
    assert not safe.met
    safe = held.gate.step((position_command([2], [0.2]),), reading(pushed, held.now), held.now)
    assert not safe.refusals


@pytest.mark.parametrize(("settings", "sag"), [(OVER_A_WIRE, 5.0), (ANSWERS, 3.0)], ids=["wire", "simulated"])
def test_a_joint_that_is_told_to_be_soft_sags_and_met_nobody(settings: GateSettings, sag: float) -> None:
    """Who bends the simulated one as far again later is met."""
    held, late = Held(at=9.0, settings=settings), 0.0 if settings is OVER_A_WIRE else 2.5
    met = set[str | None]()
    for step in range(round(2.4 / PERIOD)):
        soft = PlatformCommand(Mode.STIFFNESS, np.array([2]), 0.2 * ONE, ONE)
        held.step(*{0: [position_command([2], [0.5])], 200: [soft]}.get(step, []))
        bent = np.clip((step - np.array([205, 205 + round(1.5 / PERIOD)])) / 30.0, 0.0, 1.0)
        held.hand[2] = -np.deg2rad(bent @ [sag, late])
        met |= {one.joint for one in held.safe.met}
        if step == round(1.8 / PERIOD):
            assert not met
            assert held.sent[2] == pytest.approx(0.5, abs=1e-9)
    assert held.gate.state is GateState.RUN
    assert met == ({"joint2"} if late else set())


def test_a_joint_that_sags_met_nobody_by_other_settings_either() -> None:
    held = Held(at=9.0)
    held.step(position_command([2], [0.5]))
    for step in range(400):
        soft = PlatformCommand(Mode.STIFFNESS, np.array([2]), 0.2 * ONE, ONE)
        held.step(*[soft] * (step == 200))
        held.hand[2] = -np.deg2rad(3.0 * min(max(step - 205, 0) / 30.0, 1.0))
        if step == 330:
            held.gate.set_contact(ContactSettings(felt=20.0))
        assert not held.safe.met
    assert held.sent[2] == pytest.approx(0.5, abs=1e-9)


def test_only_what_a_weight_can_do_to_a_softer_joint_is_taken_for_its_sag() -> None:
    """Two joints are told in turn. The second, at 0.9 of its stiffness, is bent by 5.8 degrees at once."""
    held, met = Held(at=9.0), set[str | None]()
    held.step(position_command([1, 2], [0.5, 0.5]))
    for step in range(300):
        servo, share = (1, 0.2) if step == 200 else (2, 0.9)
        soft = PlatformCommand(Mode.STIFFNESS, np.array([servo]), share * ONE, ONE)
        held.step(*[soft] * (step in (200, 201)))
        bent = min(max(step - 205, 0) / 30.0, 1.0)
        held.hand[1:3] = -np.deg2rad([3.0 * bent, 5.8 * bent])
        met |= {one.joint for one in held.safe.met}
    assert met == {"joint2"}


@pytest.mark.parametrize("touch", [0.0, 2.0, 14.0])
def test_a_resting_arm_that_gets_a_weight_holds_it_after_two_steps(touch: float) -> None:
    """Without skin nobody knows whether it is a hand. Somebody who touched it elsewhere made it sink by 86
    degrees."""
    held = Held(at=10.0)
    held.step(position_command([2], [0.5]))
    for _ in range(1200):
        held.step()
    for step in range(3000):
        held.hand[2] = -np.deg2rad(min(0.05 * step, 2.5))
        held.step(contacts=pressed(touch) if touch else None)
    assert not held.told
    assert 0.5 - np.deg2rad(5.2) < held.sent[2] < 0.5 - np.deg2rad(2.0)


@pytest.mark.parametrize(
    ("name", "seed"), [("icub", 0), ("icub", 1), ("icub", 4), ("nao", 5), ("g1", 8), ("talos", 27)]
)
def test_a_clamped_person_is_freed(name: str, seed: int) -> None:
    """65 N is the least quasi-static limit of ISO/TS 15066."""
    robot = load_robot(name)
    trial = draw(robot, seed)
    before = squeeze(robot, trial, settings=ALONE)
    assert before.late > (15.0 if before.felt else 12.0), "this trial shows nothing"
    after = squeeze(robot, trial, settings=ANSWERS)
    assert after.half <= 65.0
    assert after.late <= 15.0
    assert after.over <= 0.2
    assert after.state == "RUN"


def test_an_arm_that_went_back_into_somebody_by_less_than_it_notices_eases() -> None:
    """Somebody at a Talos' elbow, 2.6 mm behind it, bore 125 N for ever: half of the torque that counts, with
    the opposite sign of what its joints bore when they met the first."""
    robot = load_robot("talos")
    after = squeeze(robot, draw(robot, 11, by="gesture"), settings=STIFF, behind=0.00257)
    assert after.other.peak > 100.0, "it met the second"
    assert max(after.late, after.other.late) <= 30.0


@pytest.mark.parametrize(
    ("name", "seed", "behind", "most", "settings"),
    [
        ("icub", 35, 0.00676, 15.0, ANSWERS),
        ("talos", 71, 0.005068, 30.0, ANSWERS),
        ("icub", 2, 0.005232242684986328, 15.0, ANSWERS),
        ("g1", 2, 0.005232242684986328, 15.0, ANSWERS),
        ("talos", 2, 0.005232242684986328, 30.0, STIFF),
    ],
)
def test_going_back_from_one_person_the_arm_does_not_stay_pressed_against_another(
    name: str, seed: int, behind: float, most: float, settings: GateSettings
) -> None:
    """Without a look at the way back, 120 N were left on iCub's second after half a second, 27 N after two.
    Talos' wrist, which nobody commands and no skin covers, left 77 and 49 N. By bent joints alone iCub's
    forearm left 111 N between two, dry friction of a G1 22 N, and another wrist of Talos 44 N."""
    robot = load_robot(name)
    after = squeeze(robot, draw(robot, seed), settings=settings, behind=behind)
    assert after.other.peak > 1.0, "the second must be met"
    assert max(after.half, after.other.half) <= 65.0
    assert max(after.late, after.other.late) <= most


class Waves(Capability[int]):
    """Moves both arms at full speed to random postures."""

    def init(self, body: GenericBody) -> int:
        return 0

    def step(self, memory: int, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], int]:
        random = np.random.default_rng(memory)
        arms = [part for part in body.robot.parts if part.kind == "arm"] if memory % 80 == 0 else []
        goals = [arm.initial_posture + random.uniform(-0.6, 0.6, len(arm.initial_posture)) for arm in arms]
        orders = [
            GenericCommand(arm.name, Mode.POSITION, goal) for arm, goal in zip(arms, goals, strict=True)
        ]
        return tuple(orders), memory + 1


@pytest.mark.parametrize(("name", "rate"), [("icub", 100.0), ("nao", 50.0), ("nao", 500.0)])
def test_healthy_but_late_coarse_and_dirty_robots_meet_nothing(name: str, rate: float) -> None:
    for seed in (0, 101):  # at 101 a joint of NAO overshoots, and waits for its reference
        plant = RigidRobot(load_robot(name), seed=seed, rate=rate)
        with RigidDriver(plant, settings=ANSWERS) as driver:
            result = run(driver, Waves(), duration=6.0)
        assert result.state is GateState.RUN, result
        assert not result.went_back, result
        assert result.moved, "a robot that stands still shows nothing"


def test_the_judge_is_a_stranger() -> None:
    for name in ("rigid_robot", "squeezed", "squeezes", "struck", "four_modes", "healthy"):
        tree = ast.parse((HELPERS / f"{name}.py").read_text())
        nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]
        modules = [getattr(node, "module", None) for node in nodes]
        imported = {
            f"{module}.{one.name}" if module else one.name
            for node, module in zip(nodes, modules, strict=True)
            for one in node.names
        }
        assert not [one for one in imported if one.startswith(("tci.gate", "tci.simulation"))]
        inner = [node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr[0] == "_"]
        assert not [node.lineno for node in inner if ast.unparse(node.value).endswith("gate")]
