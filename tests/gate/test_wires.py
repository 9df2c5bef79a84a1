"""Robots behind a wire: what their torques mean is unknown until they have moved without a contact."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from helpers.gate_checks import reading
from helpers.healthy import Healthy
from helpers.rigid_robot import WIRE
from tci.gate.contact.reaction import ContactReaction
from tci.gate.joint_group import groups_of
from tci.gate.joint_monitor import Reference
from tci.gate.settings import OVER_A_WIRE
from tci.messages import Mode
from tci.messages.frames import Array, read_only
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot

PERIOD, JOINT, SPEED = 0.01, "arm_left_2_joint", 1.0


@cache
def talos() -> Robot:
    return load_robot("talos")


def told(
    *,
    at: float = 0.6,
    torque: float = 0.0,
    met: float = 0.0,
    lag: float = 0.05,
    droops: float = 0.0,
    unit: float = 1.0,
    stall: float = 0.0,
    back: float = 0.0,
    lasts: float = 0.8,
) -> str:
    """What is told of a joint that goes back and forth at 57 degrees/s.

    Args:
        at: time [s].
        torque: what it bears [N m] more from `met` on, by default from `at` on.
        met: time [s].
        lag: time [s] by which it follows.
        droops: angle [rad] that it hangs lower in the course of each way.
        unit: of its torques [N m], of which friction is 5.
        stall: time [s] before `at` for which no reading comes; then one comes that is as old as it.
        back: time [s] by which the clock goes back 0.05 s after `at`.
        lasts: time [s] of all.
    """
    robot, found = talos(), list[str]()
    names = [servo.name for servo in robot.servos]
    settings = OVER_A_WIRE.contact
    assert settings is not None
    meets, own = ContactReaction(robot, groups_of(robot), settings), names.index(JOINT)

    def way(time: Array | float) -> tuple[float, float]:
        turn = 2.0 * SPEED * np.maximum(time, 0.0)
        return float(0.5 * (1.0 - np.cos(turn))), float(SPEED * np.sin(turn))

    for step in range(round(lasts / PERIOD)):
        now = step * PERIOD
        clock = now + (back if now < at + 0.05 else 0.0)
        asked, rate = way(now)
        reference = Reference(
            np.array([own]), (Mode.POSITION,), np.array([asked]), np.array([rate]), np.zeros(1)
        )
        silent = at - stall < now < at
        late = lag + (stall if at <= now < at + PERIOD else 0.0)
        angles, torques = np.zeros((2, len(names)))
        angles[own] = way(now - late)[0] * (1.0 - droops)
        torques[own] = unit * 5.0 * np.sign(rate)
        torques[own] += torque * (now >= (met or at))
        seen = replace(reading(angles, clock), torque=read_only(torques))
        if not silent:
            found += [why.text for why in meets.step(seen, reference, clock, None)[1]]
    return "; ".join(found)


def test_torques_tell_once_motion_has_shown_that_they_are_what_they_seem() -> None:
    assert "bears 40.0 N m more" in told(torque=40.0, at=2.1, lasts=2.3)
    assert not told(torque=40.0, at=0.15, lasts=0.3)


def test_whom_a_joint_met_in_a_gap_between_readings_is_told_of_after_it() -> None:
    assert "bears" in told(torque=90.0, at=2.1, stall=0.1, lasts=2.6)


def test_a_clock_that_goes_back_just_after_a_gap_silences_nobody() -> None:
    assert "bears 40.0 N m more" in told(torque=40.0, at=1.7, met=2.1, stall=0.1, back=60.0, lasts=2.3)


@pytest.mark.parametrize(
    "case",
    [
        {"lag": 0.25},
        {"lag": 0.1, "droops": 0.08},
        {"unit": 200.0},
        {"unit": 200.0, "torque": 8000.0},
        {"stall": 0.15},
        {"stall": 0.1, "lag": 0.1},
    ],
    ids=[
        "it follows late",
        "its weight bends it",
        "milliamperes",
        "more of them",
        "nothing comes",
        "nor here",
    ],
)
def test_what_is_usual_behind_a_wire_is_nobody(case: dict[str, float]) -> None:
    assert not told(at=1.57, lasts=4.0, **case)


def test_a_healthy_robot_on_a_network_that_stalls_meets_nobody() -> None:
    """Alex' torso throws its arms more than the model says, and readings are late: torques told of somebody
    at its shoulder, from its first moment on."""
    trial = Healthy(load_robot("alex"), Mode.POSITION, 3, rate=100.0, dirt=WIRE, settings=OVER_A_WIRE)
    trial.run(4.0)
    assert not [one for one in trial.alarms if "met something" in one or " by " in one], trial.alarms
    assert trial.moved > 10.0
