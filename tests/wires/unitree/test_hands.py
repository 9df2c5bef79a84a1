"""Values of the pressure sensors of Dex3 hands arrive as skin patches."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tci
from helpers.dds_domains import DOMAINS
from tci.errors import DriverError
from tci.messages import JointReading, Mode, SkinFrame
from tci.messages.frames import read_only
from tci.robot.description import Address, Binding, Robot
from tci.shared.interface_node import InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.finger_motors import FingerMotors
from tci.wires.unitree.hands import Hand, pads_of, patches_of
from tci.wires.unitree.served_hands import ServedHand
from tci.wires.unitree.wire import MOTOR_STATE, PRESS, decode_hand, decode_hand_command, encode_hand

PADS = 26
"""Number of sensors of the hand in these tests. The forearm's patch of the description has 26 x 12
channels."""


def handed(side: str = "left") -> Robot:
    """Returns a G1 whose left forearm patch receives the data of a hand."""
    robot = tci.load_robot("g1")
    own = Binding(
        middleware="unitree", rate=250, stale_after=0.1, addresses=(Address(of="left_forearm", to=side),)
    )
    return robot.model_copy(update={"bindings": (own,)})


class Sender:
    """Sends the data of a simulated hand, and reads them with TCI."""

    def __init__(self) -> None:
        domain = next(DOMAINS)
        self.node, self.robot = InterfaceNode("lo", domain), InterfaceNode("lo", domain)
        self.hand = Hand(handed(), "left", self.node)
        self.out = self.robot.out("rt/dex3/left/state", messages.HAND_STATE)
        self.pads: Any = np.zeros(PADS, PRESS)
        self.pads["pressure"] = 100_000.0 + np.arange(12 * PADS).reshape(PADS, 12)

    def send(self, data: bytes | None = None) -> SkinFrame:
        """Sends messages until a new frame has arrived, and returns the frame."""
        before = self.frames()
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            self.out(data or encode_hand(np.zeros(7, MOTOR_STATE), self.pads))
            time.sleep(0.02)
            frames = self.frames()
            if frames and (not before or frames[0].sequence > before[0].sequence):
                return frames[0]
        raise AssertionError("no frame")

    def frames(self) -> tuple[SkinFrame, ...]:
        self.hand.poll(time.monotonic())
        return self.hand.frames

    def close(self) -> None:
        self.node.close()
        self.robot.close()


@pytest.fixture
def hand() -> Any:
    made = Sender()
    yield made
    made.close()


def test_a_hands_sensors_are_a_patch(hand: Sender) -> None:
    frame = hand.send()
    assert frame.patch == "left_forearm"
    assert frame.values.tolist() == (100_000.0 + np.arange(12 * PADS)).tolist()
    assert 0.0 <= time.monotonic() - frame.stamp < 5.0
    assert hand.send().sequence > frame.sequence


def test_places_without_a_sensor_and_lost_data_have_no_value(hand: Sender) -> None:
    hand.pads["pressure"][3, 5] = 30_000.0
    assert np.flatnonzero(np.isnan(hand.send().values)).tolist() == [3 * 12 + 5]
    hand.pads["lost"][7] = 2
    before = hand.frames()[0].sequence
    hand.out(encode_hand(np.zeros(7, MOTOR_STATE), hand.pads))
    while (frame := hand.frames()[0]).sequence == before:
        time.sleep(0.002)
    assert np.isnan(frame.values.reshape(PADS, 12)[7]).all()
    assert np.isnan(frame.values).sum() == 13
    assert np.isnan(hand.send().values).sum() == 1  # nothing more was lost


def test_a_message_with_another_number_of_sensors_is_refused(hand: Sender) -> None:
    hand.pads = np.zeros(9, PRESS)
    with pytest.raises(DriverError, match="9 press sensors of 12 values, left_forearm has 312 channels"):
        hand.send()


def test_a_robot_keeps_what_it_sends_and_what_its_joints_feel() -> None:
    assert [patch.name for patch in patches_of(handed())] == ["left_forearm"]
    assert not patches_of(tci.load_robot("g1"))
    bare = tci.load_robot("g1-bare")
    assert patches_of(bare) == bare.patches


def test_a_hand_has_a_side() -> None:
    node = InterfaceNode("lo", next(DOMAINS))
    try:
        for wrong in ("middle", "left:7", "left:3-1"):
            with pytest.raises(DriverError, match=f"left_forearm is on the hand '{wrong}'; valid: left"):
                Hand(handed(wrong), "left", node)
    finally:
        node.close()


def test_a_hand_is_led_by_the_vendors_names_or_by_addresses_and_holds_until_it_is_released() -> None:
    """One motor is commanded. The other motors hold their present posture, and their messages contain the bit
    that stops them on a timeout."""
    robot = tci.load_robot("g1")
    servos = tuple(
        servo.model_copy(update={"name": {0: "left_hand_index_0_joint"}.get(servo.index, servo.name)})
        for servo in robot.servos
    )
    nodes = [InterfaceNode("lo", domain) for domain in [next(DOMAINS)] * 2]
    heard = nodes[0].reader("rt/dex3/left/cmd", messages.HAND_COMMAND)
    hand = Hand(robot.model_copy(update={"servos": servos}), "left", nodes[1])
    assert (hand.servos.tolist(), hand.motors.tolist()) == ([0], [5])
    hand.state = np.zeros(7, MOTOR_STATE)
    hand.state["q"] = 0.1 * np.arange(7)
    fingers = FingerMotors(nodes[1], hand)

    def received(send: Callable[[], None]) -> Any:
        end = time.monotonic() + 10.0
        while not (found := latest(heard)):
            send()
            assert time.monotonic() < end
            time.sleep(0.005)
        return decode_hand_command(found[-1].raw)

    fingers.repeat(time.monotonic())
    one = np.ones(1)
    safe: Any = SimpleNamespace(  # a substitute, because only a gate can make a SafeCommand
        servos=np.array([0]), modes=(Mode.POSITION,), position=-0.9 * one, velocity=0.2 * one,
        torque=0.0 * one, stiffness={0: 0.5}, damping={},
    )  # fmt: skip
    fingers.obey(safe)
    command = received(lambda: fingers.repeat(time.monotonic()))
    assert command["mode"].tolist() == [0x90 | number for number in range(7)]
    np.testing.assert_allclose(command["q"], [0.0, 0.1, 0.2, 0.3, 0.4, -0.9, 0.6], rtol=1e-6)
    np.testing.assert_allclose(command["dq"], [0.0] * 5 + [0.2, 0.0], rtol=1e-6)
    np.testing.assert_allclose(command["kp"], [1.5] * 5 + [0.75, 1.5])
    time.sleep(0.05)
    latest(heard)
    fingers.release()
    command = received(lambda: None)
    assert command["mode"].tolist() == [0x80 | number for number in range(7)]
    assert not command["kp"].any()
    time.sleep(0.05)
    latest(heard)
    fingers.obey(safe)  # after a stop, the gate still sends the present positions
    fingers.repeat(time.monotonic() + 1.0)
    fingers.release()
    time.sleep(0.05)
    assert not latest(heard)
    for node in nodes:
        node.close()


@pytest.fixture(scope="module")
def ends() -> Iterator[tuple[Robot, ServedHand, Hand]]:
    """Yields the left hand of a G1 with Dex3 hands without physics: robot, the side of the server and the
    side of the driver."""
    robot, domain = tci.load_robot("g1-hands"), next(DOMAINS)
    nodes = [InterfaceNode("lo", domain) for _ in range(2)]
    yield robot, ServedHand(robot, "left", nodes[0]), Hand(robot, "left", nodes[1])
    for node in nodes:
        node.close()


def within(seconds: float, step: Callable[[], bool]) -> None:
    """Repeats a step until the step returns True."""
    end = time.monotonic() + seconds
    while not step():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_each_press_sensor_belongs_to_one_patch() -> None:
    robot = tci.load_robot("g1-hands")
    for side in ("left", "right"):
        pads = pads_of(robot, side)
        found = sorted(pad for place in pads.values() for pad in range(place.start, place.stop))
        assert found == list(range(9))
        for name, place in pads.items():
            assert 12 * (place.stop - place.start) == robot.patch(name).channels


def test_a_served_hand_tells_its_fingers_and_its_sensors(ends: Any) -> None:
    robot, served, hand = ends
    values = {
        p.name: 1e5 + 10.0 * number + np.arange(p.channels) for number, p in enumerate(patches_of(robot))
    }
    skin = tuple(SkinFrame(name, 0.0, 0, read_only(own, np.float32)) for name, own in values.items())
    position = 0.01 * np.arange(len(robot.servos))
    joints = JointReading(0.0, 0, position, -position, 2.0 * position)

    def step() -> bool:
        served.publish(joints, skin, time.monotonic())
        hand.poll(time.monotonic())
        return hand.state is not None

    within(10.0, step)
    found = [np.zeros(len(robot.servos)) for _ in range(3)]
    hand.fill(*found, time.monotonic())
    own = [servo.index for servo in robot.servos if servo.name.startswith("left_hand")]
    for there, sent in zip(found, (joints.position, joints.velocity, joints.torque), strict=True):
        np.testing.assert_allclose(there[own], np.asarray(sent)[own], rtol=1e-6)
        assert not np.delete(there, own).any()
    assert {frame.patch for frame in hand.frames} == {name for name in values if name.startswith("left")}
    for frame in hand.frames:
        np.testing.assert_allclose(frame.values, values[frame.patch])
    assert not hand.fault
    served._state["temperature"][4, 1] = 121
    within(10.0, lambda: step() and bool(hand.fault))
    assert hand.fault == "left_hand_middle_1 has a winding above 120 C: 121"
    served._state["temperature"][4, 1] = 30
    time.sleep(0.02)
    step()
    assert hand.fault  # until a person connects the driver again


@pytest.mark.parametrize(
    ("field", "value", "word"),
    [("motorstate", 3, "right_hand_thumb_2 reports the error 3"), ("q", np.nan, "reports the angle nan"),
     ("", 7, "the right hand reports the errors 0, 7")],
)  # fmt: skip
def test_a_fault_of_a_hand_is_named(field: str, value: float, word: str) -> None:
    motors: Any = np.zeros(7, MOTOR_STATE)
    data = bytearray()
    if field:
        motors[field][2] = value
    data += encode_hand(motors, np.zeros(9, PRESS))
    if not field:
        data[-12:-8] = int(value).to_bytes(4, "little")
    state = decode_hand(bytes(data))
    node = InterfaceNode("lo", next(DOMAINS))
    with closing(node):
        hand = Hand(tci.load_robot("g1-hands"), "right", node)
        assert word in hand._fault(state.motors, state.errors)
