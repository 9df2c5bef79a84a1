"""The behaviour's side of the module `remote`, with a manual clock and a transport that the test controls."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.remote_wire import Wire
from tci.body import GenericBody
from tci.drivers.remote.driver import WINDOW
from tci.drivers.remote.protocol import Commander, Orders
from tci.errors import DriverError
from tci.gate.safe_command import GateState
from tci.messages import Met
from tci.reasons import Code, Reason
from tci.runtime.control import Control

HALTED = Reason(Code.HALTED, "halted")


@pytest.fixture
def wire() -> Wire:
    return Wire()


def test_what_was_held_up_is_old_and_a_longer_way_counts_after_a_while(wire: Wire) -> None:
    for _ in range(100):
        wire.time.advance(0.01)
        assert wire.age(late=0.001) == pytest.approx(0.0)
    for silence in (0.5, 3.0, 60.0):
        wire.time.advance(silence)
        # Many messages arrive at once, the oldest first.
        for left in np.linspace(0.9 * silence, 0.0, 20):
            assert wire.age(late=0.001 + left) == pytest.approx(left)
    ages = []
    for _ in range(round(1.5 * WINDOW / 0.01)):
        wire.time.advance(0.01)
        ages.append(wire.age(late=0.201))
    assert ages[0] == pytest.approx(0.2)
    assert ages[-1] == pytest.approx(0.0)


def test_what_the_robots_process_holds_for_is_not_said_back_however_often_it_is_read(wire: Wire) -> None:
    """If the hold of one process were reported back as a reason to hold, both processes would hold each other
    without end."""
    wire.order()
    for states in (("hold",), ("hold", "run"), ("run", "hold"), ("run",)):
        for wire.there in states:
            wire.tell()
            reading = wire.read()
        sent = wire.write(wire.gate.step([], reading.joints, wire.time.now()))
        wire.time.advance(wire.period)
        assert (sent.state is GateState.HOLD) == ("hold" in states)
        assert wire.said[-1].halt is None
    wire.gate.hold("our own reason")
    assert str(wire.order().reason) == "our own reason"
    assert wire.said[-1].halt == Reason(Code.OTHER, "our own reason")


def test_a_halt_is_said_until_the_robot_holds_and_nothing_ordered_is_said_again(wire: Wire) -> None:
    order = wire.native("LArm").command({"LElbowRoll": -1.2})
    wire.order(order)
    assert len(wire.said[-1].orders) == 1

    def hold(orders: Orders) -> None:
        wire.said.append(orders)
        wire.there = "hold" if len(wire.said) >= 4 else "run"
        wire.tell()

    wire._put = hold
    wire.halt()
    assert [message.halt for message in wire.said[1:]] == [HALTED] * 3
    assert not any(message.orders for message in wire.said[1:])
    wire.there = "run"
    sent = wire.order(order)
    assert len(sent.orders) == 1
    assert wire.said[-1].first == 2
    assert wire.said[-1].halt is None


def test_a_halt_that_nobody_answers_ends_when_the_robot_holds_by_itself(wire: Wire) -> None:
    wire.order(wire.native("LArm").command({"LElbowRoll": -1.2}))
    before = wire.time.now()
    wire.halt()
    assert {message.halt for message in wire.said[1:]} == {HALTED}
    assert wire.time.now() - before == pytest.approx(wire.gate.stale_after, abs=2 * wire.period)


def test_one_who_ordered_nothing_halts_nothing(wire: Wire) -> None:
    wire.tell()
    wire.read()
    wire.halt()
    assert not wire.said


def test_what_the_robots_gate_met_is_perceived_in_the_same_period(wire: Wire) -> None:
    """Without it, a capability orders a part that goes back, and is refused."""
    met = (Met("left_arm", 20.0, "LElbowRoll", 0.05, "retreat"),)
    for wire.met in (met, ()):
        wire.tell()
        wire.time.advance(wire.period)
        moment = Control(wire, GenericBody(wire.robot)).observe()
        assert moment is not None
        assert moment.perceived().met == wire.met
        assert wire.gate.step([], moment.reading.joints, moment.now).met == wire.met


def test_what_the_robots_gate_answers_is_told_once(wire: Wire) -> None:
    """Without it, a motion that ended in a contact ended here as if it had been made."""

    def told(*met: Met) -> list[str]:
        wire.met = met
        return [str(reason) for reason in wire.order().clamped if reason.code is Code.CONTACT]

    held = Met("left_arm", 20.0, "LElbowRoll", float(np.deg2rad(3.0)), "retreat")
    palm = Met("left_hand", 20.0, "LElbowRoll", float(np.deg2rad(3.0)), "retreat")
    assert told(Met("left_arm", 8.0, None, 0.0, "told")) == []
    assert told(held, palm) == [
        "left_arm and left_hand met something: LElbowRoll is held 3.0 degrees behind; it goes back"
    ]
    waits = Met("left_arm", 0.0, None, 0.0, "waits")
    assert told(held) == told(waits) == told(held) == told() == []
    assert told(Met("left_arm", 20.0, None, 0.0, "stop")) == [
        "left_arm met something: 20 N on its skin; it stops"
    ]


def test_a_driver_whose_wire_is_cut_is_closed_all_the_same(wire: Wire) -> None:
    wire.order(wire.native("LArm").command({"LElbowRoll": -1.2}))
    wire.cut = True
    wire.close()
    with pytest.raises(DriverError, match="closed"):
        wire.read()


def test_a_driver_that_has_not_read_for_a_while_leaves_with_a_message_that_counts(wire: Wire) -> None:
    """The robot's process rejects messages that refer to an old state. Then the joints would stay reserved
    for this commander."""
    wire.order(wire.native("LArm").command({"LElbowRoll": -1.2}))
    wire.time.advance(5.0)
    wire.tell()
    wire.close()
    assert wire.said[-1].leaving
    assert wire.said[-1].seen == wire.time.now()


@pytest.mark.parametrize("text", ["left_elbow: commanded by another already", "links: besetzt"])
def test_an_order_for_joints_of_another_commander_is_an_error_by_its_code_not_its_text(
    wire: Wire, text: str
) -> None:
    wire.told = (Commander(wire.client, "test", 1, 1, Reason(Code.OTHER_COMMANDER, text)),)
    wire.tell()
    with pytest.raises(DriverError, match=text) as raised:
        wire.read()
    assert raised.value.code is Code.OTHER_COMMANDER
    wire.told = (Commander(wire.client, "test", 2, 2, Reason(Code.IN_MOTION, text)),)
    sent = wire.order()
    assert sent.reason == Reason(Code.OWNER_REFUSES, f"refused by the robot's process: {text}")
    assert wire.said[-1].halt is None, "its own refusal is not told to the robot's process"
