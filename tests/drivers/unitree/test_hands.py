"""Press sensors of Dex3 hands arrive as patches of skin."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

import tci
from drivers.unitree.test_keeper import DOMAINS
from tci.drivers.unitree import messages
from tci.drivers.unitree.hands import HandSkin, patches_of
from tci.drivers.unitree.node import UnitreeNode
from tci.drivers.unitree.wire import MOTOR_STATE, PRESS, encode_hand
from tci.errors import DriverError
from tci.messages import SkinFrame
from tci.robot.description import Address, Binding, Robot

PADS = 26
"""Sensors of the hand of these tests: the forearm's patch of the description has 26 x 12 channels."""


def handed(side: str = "left") -> Robot:
    """Returns a G1 whose left forearm's patch stands for that of a hand."""
    robot = tci.load_robot("g1")
    own = Binding(
        middleware="unitree", rate=250, stale_after=0.1, addresses=(Address(of="left_forearm", to=side),)
    )
    return robot.model_copy(update={"bindings": (own,)})


class Hand:
    """A hand and its reader."""

    def __init__(self) -> None:
        domain = next(DOMAINS)
        self.node, self.robot = UnitreeNode("lo", domain), UnitreeNode("lo", domain)
        self.skin = HandSkin(handed(), self.node)
        self.out = self.robot.out("rt/dex3/left/state", messages.HAND_STATE)
        self.pads: Any = np.zeros(PADS, PRESS)
        self.pads["pressure"] = 100_000.0 + np.arange(12 * PADS).reshape(PADS, 12)

    def send(self, data: bytes | None = None) -> SkinFrame:
        """Returns the frame after the next message."""
        before = self.skin.frames(time.monotonic())
        end = time.monotonic() + 10.0
        while time.monotonic() < end:
            self.out(data or encode_hand(np.zeros(7, MOTOR_STATE), self.pads))
            time.sleep(0.02)
            frames = self.skin.frames(time.monotonic())
            if frames and (not before or frames[0].sequence > before[0].sequence):
                return frames[0]
        raise AssertionError("no frame")

    def close(self) -> None:
        self.node.close()
        self.robot.close()


@pytest.fixture
def hand() -> Any:
    made = Hand()
    yield made
    made.close()


def test_a_hands_sensors_are_a_patch(hand: Hand) -> None:
    frame = hand.send()
    assert frame.patch == "left_forearm"
    assert frame.values.tolist() == (100_000.0 + np.arange(12 * PADS)).tolist()
    assert 0.0 <= time.monotonic() - frame.stamp < 5.0
    assert hand.send().sequence > frame.sequence


def test_places_without_a_sensor_and_lost_data_have_no_value(hand: Hand) -> None:
    hand.pads["pressure"][3, 5] = 30_000.0
    assert np.flatnonzero(np.isnan(hand.send().values)).tolist() == [3 * 12 + 5]
    hand.pads["lost"][7] = 2
    before = hand.skin.frames(time.monotonic())[0].sequence
    hand.out(encode_hand(np.zeros(7, MOTOR_STATE), hand.pads))
    while (frame := hand.skin.frames(time.monotonic())[0]).sequence == before:
        time.sleep(0.002)
    assert np.isnan(frame.values.reshape(PADS, 12)[7]).all()
    assert np.isnan(frame.values).sum() == 13
    assert np.isnan(hand.send().values).sum() == 1  # nothing more was lost


def test_a_message_with_another_number_of_sensors_is_refused(hand: Hand) -> None:
    hand.pads = np.zeros(9, PRESS)
    with pytest.raises(DriverError, match="9 press sensors of 12 values, left_forearm has 312 channels"):
        hand.send()


def test_a_robot_keeps_what_it_sends_and_what_its_joints_feel() -> None:
    assert [patch.name for patch in patches_of(handed())] == ["left_forearm"]
    assert not patches_of(tci.load_robot("g1"))
    bare = tci.load_robot("g1-bare")
    assert patches_of(bare) == bare.patches


def test_a_hand_has_a_side() -> None:
    node = UnitreeNode("lo", next(DOMAINS))
    try:
        with pytest.raises(DriverError, match="left_forearm is on the hand 'middle'; valid: left, right"):
            HandSkin(handed("middle"), node)
    finally:
        node.close()
