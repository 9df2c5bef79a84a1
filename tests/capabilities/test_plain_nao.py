"""Behaviours of a NAO as it is sold, which feels with switches only, and what others say on it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tci
from tci.capabilities import Need, SoftHands, Sway, lacks
from tci.capabilities.contact_stop import HEAD_STOP
from tci.messages.frames import Array
from tci.testing import TouchedRobot

ARM = ("LShoulderPitch", "LShoulderRoll", "LElbowYaw", "LElbowRoll", "LWristYaw")


def angles(driver: tci.SimulatedDriver) -> Array:
    """True angles [degrees] of the left arm in the physics simulation."""
    names = [servo.name for servo in driver.robot.servos]
    found: Array = np.rad2deg(driver.world.joints().position[[names.index(joint) for joint in ARM]])
    return found


def test_while_the_head_is_touched_nothing_moves_and_then_it_goes_on() -> None:
    with tci.connect("nao-plain") as driver:
        path: list[tuple[float, Array]] = []

        def watch(tick: tci.Tick) -> None:
            world = driver.world
            path.append((tick.now, angles(driver)))
            if len(path) == 150:
                world.finger.poke("head", 2, depth=0.004)
            if len(path) == 750:
                world.finger.retire()

        result = tci.run(driver, HEAD_STOP, duration=3.0, observe=watch)
    assert "touched head (pressed)" in result.summary
    moved = {
        time: np.abs(path[k + 50][1] - path[k][1]).max()
        for k, (time, _) in enumerate(path[:-50])
    }  # fmt: skip
    touched = [way for time, way in moved.items() if 0.5 < time < 1.4]
    assert max(touched) < 0.05
    assert max(way for time, way in moved.items() if time < 0.2) > 0.5
    assert max(way for time, way in moved.items() if time > 2.0) > 0.5


def led(behaviour: tci.Capability[Any]) -> tuple[float, float]:
    """Pushes the left hand for 0.7 s and lets go: how far the arm went, and is at the end [deg]."""
    with tci.connect("nao-plain") as driver:
        home, ways = angles(driver), list[Array]()
        driver.world.finger.poke("left_hand", 1, speed=0.1, depth=0.04)

        def watch(tick: tci.Tick) -> None:
            ways.append(np.abs(angles(driver) - home))
            if len(ways) == 350:
                driver.world.finger.retire()

        tci.run(driver, behaviour, duration=2.0, observe=watch)
        return float(np.max(ways)), float(ways[-1].max())


def test_a_held_hand_is_led_and_stays_where_it_was_left() -> None:
    most, end = led(SoftHands())
    assert end > 0.9 * most > 5.0
    assert led(Sway(angle=1e-9))[1] < 1.0, "a stiff arm comes back"


def test_only_the_held_arm_is_soft_whatever_else_is_touched() -> None:
    robot, hands = TouchedRobot("nao-plain"), SoftHands()
    memory = hands.init(robot.body)
    for patch, softened in (("head", set()), ("left_bumper", set()), ("right_hand", {"right_arm"})):
        told = set()
        for _ in range(10):
            orders, memory = hands.step(memory, robot.perceive(patch, taxel=0), robot.body)
            told |= {order.part for order in orders if isinstance(order, tci.GenericCommand)}
        assert told == softened


def test_what_a_robot_lacks_is_said_in_place_of_nothing_moved(caplog: pytest.LogCaptureFixture) -> None:
    words = "no skin on an arm of this robot"
    with tci.connect("nao-plain") as driver:
        result = tci.run(
            driver, tci.Arbiter([tci.ContactStop(tci.WithdrawalReflex()), Sway()]), duration=0.01
        )
        assert result.lacks == (f"Arbiter: {words}",)
        assert f"nao-plain: Arbiter: {words}" in caplog.text
        assert words in tci.run(driver, tci.WithdrawalReflex(), duration=0.01).summary
    assert not lacks(tci.WithdrawalReflex(), "g1-bare"), "felt through joints"
    assert not lacks(HEAD_STOP, "nao-plain-h21")
    assert lacks(SoftHands(), "nao-plain-h21") == ("no skin on a hand of this robot",)
    forces = "no skin that measures force on an arm or on fingers of this robot"
    assert lacks(tci.Gentle(Sway()), "nao-plain") == (forces,), "a cap in newtons, and switches know none"
    assert not lacks(tci.Gentle(Sway()), "nao")
    assert lacks(tci.LightGrasp(), "nao") == ("no skin on a palm of this robot",)
    assert lacks(tci.BodyWithdrawal(), "nao-plain")
    assert not lacks(tci.BodyWithdrawal(), "icub-whole")
    assert not Need("wheels", ("other",), skin=False).met("nao")


@pytest.mark.parametrize("name", ["softness", "threshold", "quiet"])
def test_settings_out_of_range_are_refused(name: str) -> None:
    with pytest.raises(tci.TciError, match=f"soft hands: {name} -1"):
        SoftHands(**{name: -1.0})
