"""A joint that bears more than a moment ago, by its measured torque, has met something: long before it is
bent."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from helpers.gate_checks import reading
from helpers.squeezed import Squeeze, squeeze
from tci.errors import DescriptionError
from tci.gate.contact import bearing
from tci.gate.contact.reaction import ContactReaction
from tci.gate.contact.settings import ContactSettings, OnContact
from tci.gate.joint_group import groups_of
from tci.gate.joint_monitor import Reference
from tci.messages import Mode
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.gravity import Gravity

PERIOD, JOINT, LIMIT = 0.01, "arm_left_2_joint", 100.0


@cache
def talos() -> Robot:
    return load_robot("talos")


def told(torque: float, *, speed: float = 0.3, steady: bool = True, stands: bool = True) -> list[str]:
    """What is told when a joint that follows its reference bears `torque` [N m] after 0.6 s."""
    return borne(torque, speed=speed, steady=steady, stands=stands)[1]


def borne(torque: float, *, speed: float, steady: bool, stands: bool) -> tuple[ContactReaction, list[str]]:
    robot = talos()
    names = [servo.name for servo in robot.servos]
    meets = ContactReaction(robot, groups_of(robot), ContactSettings(stands=stands))
    own, found = np.array([names.index(JOINT)]), list[str]()
    for step in range(75):
        now = step * PERIOD
        rate = speed * (1.0 if steady else np.cos(5.0 * now))
        angles, torques = np.zeros(len(names)), np.zeros(len(names))
        angles[own] = speed * (now if steady else np.sin(5.0 * now) / 5.0)
        torques[own] = torque if now > 0.6 else 0.0
        asked = Reference(own, (Mode.POSITION,), angles[own], np.array([rate]), np.zeros(1))
        seen = replace(reading(angles, now), torque=read_only(torques))
        found += [why.text for why in meets.step(seen, asked, now, None)[1]]
    return meets, found


@pytest.mark.parametrize(("torque", "steady"), [(30.0, True), (60.0, False)])
def test_a_joint_that_bears_more_than_its_motion_explains_has_met_something(
    torque: float, steady: bool
) -> None:
    assert f"{JOINT} bears {torque} N m more than a moment ago" in told(torque, steady=steady)[0]


def test_whom_a_braking_arm_meets_is_told_as_soon_as_its_joints_lag_no_more() -> None:
    """A joint that followed without a lag brakes for 0.1 s from 0.6 s on; the longest lag would be over at
    0.8 s."""
    robot = talos()
    own = np.array([[servo.name for servo in robot.servos].index(JOINT)])
    meets, found = ContactReaction(robot, groups_of(robot), ContactSettings()), list[float]()
    angles, torques = np.zeros((2, len(robot.servos)))
    for now in np.arange(0.0, 1.0, PERIOD).tolist():
        rate = 1.5 * min(max((0.7 - now) / 0.1, 0.0), 1.0)
        angles = angles.copy()
        angles[own] += rate * PERIOD
        torques = np.where(np.isin(np.arange(len(angles)), own), 32.0 * (now > 0.65), 0.0)
        asked = Reference(own, (Mode.POSITION,), angles[own], np.array([rate]), np.zeros(1))
        seen = replace(reading(angles, now), torque=read_only(torques))
        found += [now for _ in meets.step(seen, asked, now, None)[1]]
    assert 0.65 < found[0] < 0.78


def test_perceptions_tell_which_joint_bears_it() -> None:
    """They told of 0 N on skin."""
    reaction, _ = borne(30.0, speed=0.3, steady=True, stands=True)
    assert reaction.met[0].joint == JOINT
    assert str(reaction.met[0]).endswith(
        f" met something: {JOINT} bears more than a moment ago; it goes back"
    )


@pytest.mark.parametrize(
    ("torque", "speed", "steady", "stands"),
    [
        (0.15 * LIMIT, 0.3, True, True),  # three times the usual dry friction
        (30.0, 1.5, False, True),  # it accelerates by up to 7.5 rad/s2
        (30.0, 0.0, True, True),  # at rest somebody pushes it
        (30.0, 0.3, True, False),  # over a wire nobody knows how late readings are
    ],
)
def test_what_motion_friction_or_a_hand_explains_is_no_contact(
    torque: float, speed: float, steady: bool, stands: bool
) -> None:
    assert not told(torque, speed=speed, steady=steady, stands=stands)


def told_at_rest(
    torque: float,
    *,
    way: float,
    weight: float = 0.0,
    late: float = 0.0,
    lasts: tuple[float, float] = (1.2, 1.8),
) -> list[str]:
    """What is told of a joint that goes up by `way` [rad] within a second, always accelerating or braking,
    and bears `torque` [N m] between two times [s], and `weight` times what its links weigh. It begins after
    0.3 s. Readings come `late` [s]."""
    robot = talos()
    names = [servo.name for servo in robot.servos]
    meets, own, found = ContactReaction(robot, groups_of(robot), ContactSettings()), names.index(JOINT), []
    for step in range(180):
        now = step * PERIOD
        turn = np.pi * np.clip(now - 0.3, 0.0, 1.0)
        angles, torques = np.zeros(len(names)), np.zeros(len(names))
        angles[own], rate = 0.5 * way * (1.0 - np.cos(turn)), 0.5 * way * np.pi * np.sin(turn)
        torques[own] = (torque if lasts[0] < now < lasts[1] else 0.0) + weight * Gravity(robot).torques(
            angles
        )[own]
        asked = Reference(np.array([own]), (Mode.POSITION,), angles[[own]], np.array([rate]), np.zeros(1))
        seen = replace(reading(angles, now - late), torque=read_only(torques))
        found += [why.text for why in meets.step(seen, asked, now, None)[1]]
    return found


@pytest.mark.parametrize("late", [0.0, 0.003])
def test_whom_a_joint_met_while_it_braked_is_told_of_when_it_rests(late: float) -> None:
    """Torques of all of a moment ago are with them already."""
    assert f"{JOINT} bears 50.0 N m more" in told_at_rest(50.0, way=0.8, late=late)[0]


@pytest.mark.parametrize("masses", [True, False])
def test_torques_tell_while_a_joint_accelerates_if_its_masses_are_known(
    monkeypatch: pytest.MonkeyPatch, masses: bool
) -> None:
    def unknown(*_: object) -> None:
        raise DescriptionError("talos", ())

    if not masses:
        monkeypatch.setattr(bearing, "Dynamics", unknown)
    assert bool(told_at_rest(-60.0, way=0.8, lasts=(0.4, 0.7))) == masses


def test_a_lever_that_grew_since_the_joint_rested_is_nobody() -> None:
    """30 N m by the model, and a fifth more; 21 N m tell of somebody."""
    assert not told_at_rest(0.0, way=1.5, weight=1.2)


@pytest.mark.parametrize(("answer", "goes"), [("stop", 1), ("soft", 2)])
def test_only_a_part_that_gives_way_unloads_its_joints(answer: OnContact, goes: int) -> None:
    """One that must stop, as the waist of a robot that stands, is sent nowhere later."""
    robot, ways = talos(), 0
    names = [servo.name for servo in robot.servos]
    settings = ContactSettings(answers={"left_arm": answer, "left_hand": answer})
    meets, own = ContactReaction(robot, groups_of(robot), settings), names.index(JOINT)
    for step in range(160):
        now = step * PERIOD
        angle, rate = 0.3 * min(now, 0.63), 0.3 * (now < 0.63)
        angles, torques = np.zeros(len(names)), np.zeros(len(names))
        angles[own], torques[own] = angle - 0.005, 30.0 if 0.6 < now < 0.65 else 8.0 if now > 0.65 else 0.0
        asked = Reference(np.array([own]), (Mode.POSITION,), np.array([angle]), np.array([rate]), np.zeros(1))
        seen = replace(reading(angles, now), torque=read_only(torques))
        ways += len(meets.step(seen, asked, now, None)[0])
    assert ways == goes


def test_a_way_back_ends_before_a_joint_began_to_bear_more_however_slowly_that_grew() -> None:
    """Near the axis somebody bears much before a joint does: an arm that went back from 0.05 s before it was
    sure left 59 N on them."""
    robot = talos()
    names = [servo.name for servo in robot.servos]
    meets, own = ContactReaction(robot, groups_of(robot), ContactSettings()), names.index(JOINT)
    for step in range(90):
        now = step * PERIOD
        angles, torques = np.zeros(len(names)), np.zeros(len(names))
        angles[own], torques[own] = now, np.clip((now - 0.6) * 150.0, 0.0, 30.0)
        asked = Reference(np.array([own]), (Mode.POSITION,), angles[[own]], np.array([1.0]), np.zeros(1))
        seen = replace(reading(angles, now), torque=read_only(torques))
        ways = meets.step(seen, asked, now, None)[0]
        if ways:
            break
    assert ways, "it was met"
    assert now > 0.73, "the joint bore too little until then"
    end = ways[0].angles[ways[0].servos.tolist().index(own)]
    assert end < 0.65, "somebody bears 5 of 20 N m there"


def next_way(torque: float, *, swings: float = 0.0) -> float | None:
    """How far [rad] the joint is sent when it has gone back and bears `torque` [N m] there, moving with
    `swings` [rad/s]; less than 0 is farther back. None if it is not sent anywhere."""
    robot = talos()
    names = [servo.name for servo in robot.servos]
    meets, own = ContactReaction(robot, groups_of(robot), ContactSettings(stands=True)), names.index(JOINT)
    angle, rate, goal = 0.0, 0.3, np.inf
    for step in range(200):
        now, there = step * PERIOD, goal < np.inf and abs(angle - goal) < 1e-9
        angles, torques = np.zeros(len(names)), np.zeros(len(names))
        angles[own], torques[own] = angle, torque if there else 30.0 if now > 0.6 else 0.0
        asked = Reference(np.array([own]), (Mode.POSITION,), angles[[own]], np.array([rate]), np.zeros(1))
        speeds = np.where(np.arange(len(names)) == own, swings if there else rate, 0.0)
        seen = replace(reading(angles, now), torque=read_only(torques), velocity=read_only(speeds))
        for way in meets.step(seen, asked, now, None)[0]:
            end = float(way.angles[way.servos.tolist().index(own)])
            if there:
                return end - angle
            goal = end
        rate = 0.3 if goal == np.inf else float(np.clip((goal - angle) / PERIOD, -0.5, 0.5))
        angle += rate * PERIOD
        rate = 0.0 if abs(angle - goal) < 1e-9 else rate
    assert goal < np.inf, "it went back"
    return None


def test_after_a_way_back_a_joint_goes_on_while_it_presses_and_turns_if_somebody_is_behind_it() -> None:
    """Of 100 N m: 8 are little more than friction, 12 still press the first, and -30 press somebody else,
    unless it swings; a robot that measures no speeds is not known to."""
    assert next_way(8.0) is None
    assert (next_way(12.0) or 0.0) < -0.01
    assert (next_way(-30.0) or 0.0) > 0.001
    assert (next_way(-30.0, swings=0.3) or 0.0) < -0.01
    assert (next_way(-30.0, swings=np.nan) or 0.0) > 0.001


def test_a_joint_that_bears_the_opposite_after_a_way_back_does_not_go_on() -> None:
    """Somebody may be behind it, though 12 of 100 N m don't tell for certain."""
    assert (next_way(-12.0) or 0.0) > -0.001


def hand(start: list[float], goal: list[float], link: str, point: list[float], at: list[float]) -> Squeeze:
    """A trial with somebody of 75 N/mm, drawn once: a seed draws other trials when limits change."""
    begin, end, own, world = (np.array(one) for one in (start, goal, point, at))
    part = link[4:].split("_")[0] + "_arm"
    return Squeeze(part, begin, end, Mode.POSITION, 0.45, 75e3, link, own, world, 500.0, 220)


def test_a_bare_link_of_a_stiff_arm_is_freed_sooner() -> None:
    """By bent joints alone somebody stood more than 65 N for 0.25 s."""
    trial = hand(
        [-0.166, 1.344, 1.619, 0.744, 1.046], [0.599, 1.528, 1.357, 0.438, -0.758],
        "arm_right_6_link", [0.002, -0.029, 0.02], [0.109, -0.791, 0.253],
    )  # fmt: skip
    assert squeeze(talos(), trial).over < 0.15


def test_an_arm_that_a_gesture_moves_is_freed_as_soon() -> None:
    """A gesture always accelerates; while that hid what joints bear, somebody stood more than 65 N for
    0.28 s."""
    trial = Squeeze(
        "right_arm", np.array([0.049, 1.113, 0.134, 0.531, -0.112]),
        np.array([0.405, -0.328, 0.383, 0.556, -0.182]), Mode.POSITION, 0.79, 21e3, "r_wrist_1",
        np.array([0.0, -0.016, 0.005]), np.array([-0.159, 0.189, -0.076]), 100.0, 3, "gesture",
    )  # fmt: skip
    assert squeeze(load_robot("icub"), trial).over < 0.2


def test_a_stiff_arm_that_went_back_does_not_stay_pressed_against_a_second_person() -> None:
    """They bear 101 N after half a second, and 73 N after two, if only bent joints tell."""
    trial = hand(
        [0.143, -0.508, -1.044, 0.72, 1.456], [0.659, 0.297, 0.833, 1.735, -1.257],
        "arm_left_7_link", [0.034, -0.033, -0.081], [0.586, 0.245, 0.154],
    )  # fmt: skip
    after = squeeze(talos(), replace(trial, share=0.88, seed=203), behind=0.01)
    assert after.other.peak > 1.0, "the second must be met"
    assert after.other.half <= 65.0
    assert max(after.late, after.other.late) <= 30.0
