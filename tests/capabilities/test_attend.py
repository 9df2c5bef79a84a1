"""The robot looks where it is touched. The judge (`helpers.attended`) has its own cameras and MuJoCo's
poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tci
from helpers.attended import Still, stroke, touch, two_people
from tci.errors import CommandError, TciError
from tci.messages import GenericCommand, Met
from tci.testing import TouchedRobot

BEFORE = {"left_arm": np.deg2rad([60, 10, 30, 80, 0])}
"""The left forearm lies before the body, where a neck can see it."""


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("nao", 1), ("nao-plain", 1), ("icub-hands", 10), ("talos", 13), ("alex", 10), ("g1", 2),
        ("g1-inspire", 0),
    ],
)  # fmt: skip
def test_it_looks_where_it_is_touched_after_it_has_withdrawn(name: str, seed: int) -> None:
    seen = touch(name, seed)
    assert seen is not None
    assert not seen.kept
    assert seen.best < 4.0, "within reach"
    assert seen.turned > 5.0
    assert seen.met, seen
    assert any(" looks at " in note for note in seen.notes)


def test_a_place_out_of_reach_is_told() -> None:
    seen = touch("nao-plain", 12)
    assert seen is not None
    assert seen.patch == "left_bumper"
    assert seen.best > 20.0
    assert seen.met
    assert any("it stays 57 degrees beside it, since its joints" in note for note in seen.notes)


def test_it_follows_a_stroke() -> None:
    seen = stroke("alex", "stroke 'left forearm' 0.2..0.8 3N 8cm/s", posture=BEFORE)
    assert seen is not None
    assert seen.turned > 8.0
    assert seen.worst <= 10.0


@pytest.mark.parametrize(("name", "seed"), [("g1", 2), ("nao-whole", 4)])
def test_nobody_is_pressed_harder_because_the_robot_looks(name: str, seed: int) -> None:
    before, after = two_people(name, seed, Still()), two_people(name, seed, tci.Attend())
    assert before is not None
    assert after is not None
    assert max(before.values()) > 1.0
    assert all(after[hand] <= force + 0.1 for hand, force in before.items())


@pytest.mark.parametrize(
    "touch", ["pat 'right forearm' 2N", "pat 'right forearm' 5N", "squeeze 'right forearm'"]
)
def test_a_waist_turns_no_arm_against_the_blows_of_a_pat_nor_after_a_hand_that_leaves(touch: str) -> None:
    """It turned between two blows: 5.9, 10.6 and 8.3 N instead of 2.2, 5.6 and 5.0."""
    peaks = []
    for capability in (Still(), tci.Attend()):
        with tci.connect("g1", "sim", people=1) as driver:
            end = max(one.end for one in driver.world.touch(touch))
            tci.run(driver, capability, duration=end + 1.0)
            peaks.append(max(hand.peak_force for hand in driver.world.person().hands))
    assert peaks[0] > 1.0
    assert peaks[1] <= peaks[0] + 0.1


def test_a_look_stops_while_the_head_is_touched_and_the_waist_while_an_arm_is() -> None:
    for name, first, second, part in (
        ("nao-plain", "left_hand", "head", "head"),
        ("g1", "left_forearm", "left_forearm", "torso"),
    ):
        robot, attend = TouchedRobot(name), tci.Attend()
        memory, orders, said = attend.init(robot.body), [], []
        for seen in [first] * 10 + [None] * 30 + [second] * 5:
            given, memory = attend.step(memory, robot.perceive(seen, force=4.0), robot.body)
            orders.append(given)
            said.append(attend.notes(memory))
        turned = [k for k, given in enumerate(orders) if given]
        assert turned[0] == 6 if name == "nao-plain" else turned[0] == 34, "not while the arm is touched"
        (stop,) = orders[40]
        assert isinstance(stop, GenericCommand)
        assert stop.part == part
        np.testing.assert_array_equal(stop.values, robot.body.robot.part(part).initial_posture)
        assert f"{part} keeps still" in said[40][0]
        assert attend.claims(memory) == {part}


@pytest.mark.parametrize("returns", [False, True])
def test_an_order_that_the_gate_dropped_while_a_part_waits_is_given_again(returns: bool) -> None:
    robot, attend = TouchedRobot("nao-plain"), tci.Attend(patience=0.2)
    memory, orders, waits, k = attend.init(robot.body), list[GenericCommand](), 0, 0
    while len(orders) < 2 + returns and k < 200:
        seen = robot.perceive("left_hand" if not returns or k < 10 else None, force=4.0)
        if len(orders) == 1 + returns and waits < 10:
            seen, waits = replace(seen, met=(Met("head", 0.0, None, 0.0, "waits"),)), waits + 1
        given, memory = attend.step(memory, seen, robot.body)
        orders, k = [*orders, *given], k + 1
    np.testing.assert_allclose(orders[-1].values, orders[-2].values, atol=1e-9)
    assert waits == 10


def test_the_gaze_returns_when_nobody_touches() -> None:
    with tci.connect("nao-plain", "sim") as driver:
        driver.world.finger.poke("left_hand", 0)
        body, held = tci.GenericBody("nao-plain"), []

        def watch(tick: tci.Tick) -> None:
            held.append(body.posture(tick.reading.joints)["head"])
            if tick.now > 0.3:
                driver.world.finger.retire()

        tci.run(driver, tci.Attend(patience=0.4), duration=1.8, observe=watch)
    angles = np.array(held)
    assert np.ptp(angles, axis=0).max() > 0.5
    assert np.abs(angles[-1] - angles[0]).max() < np.deg2rad(2.0)


def test_what_it_does_not_take_is_told() -> None:
    with pytest.raises(TciError, match=r"attend: patience 0; valid: above 0, finite"):
        tci.Attend(patience=0)
    with pytest.raises(TciError, match=r"attend: people 5; valid: a sequence of tci\.body\.Struck"):
        tci.Attend(people=5)  # type: ignore[arg-type]
    robot = TouchedRobot("nao")
    with pytest.raises(CommandError, match=r"valid: a finite point"):
        robot.body.look_at(robot.perceive(), [1.0, np.nan, 0.0])
