"""A joint that runs beyond its reference, since its motor can't brake sooner, is held by nobody."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from helpers.gate_checks import PERIOD, position_command, reading
from helpers.healthy import Healthy
from tci.gate.contact.reaction import ContactReaction
from tci.gate.contact.settings import ContactSettings
from tci.gate.gate import Gate
from tci.gate.joint_group import groups_of
from tci.gate.joint_monitor import Reference
from tci.messages import Mode
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot

SPEED, STOPS = 1.5, 1.0
"""Speed [rad/s] of the reference, and when it stops [s]."""


def told(way: Callable[[float], float]) -> tuple[list[str], set[int]]:
    """What is told of a joint that follows until its reference stops and is beyond it by `way(t)` [rad] after
    a time t [s], and which joints were seen to overshoot."""
    robot = load_robot("talos")
    own = np.array([next(one.index for one in robot.servos if one.name == "arm_left_2_joint")])
    meets = ContactReaction(robot, groups_of(robot), ContactSettings())
    found, over = list[str](), set[int]()
    angles, rates = np.zeros((2, len(robot.servos)))
    for step in range(150):
        now, before = step * 0.01, angles[own].copy()
        asked = SPEED * min(now, STOPS)
        angles[own] = asked + (way(now - STOPS) if now > STOPS else 0.0)
        rates[own] = (angles[own] - before) / 0.01
        speed = SPEED if now < STOPS else 0.0
        reference = Reference(own, (Mode.POSITION,), np.array([asked]), np.array([speed]), np.zeros(1))
        seen = replace(reading(angles, now), velocity=read_only(rates))
        found += [one.text for one in meets.step(seen, reference, now, None)[1]]
        over |= meets.overshoots
    return found, over


def test_a_joint_that_overshoots_and_swings_back_met_nobody() -> None:
    found, over = told(lambda t: 0.15 * np.exp(-5.0 * t) * np.sin(10.0 * t))
    assert not found
    assert over, "it must run beyond its reference"


@pytest.mark.parametrize("speed", [0.6, 3.0])
def test_a_joint_that_is_pushed_beyond_its_reference_met_somebody(speed: float) -> None:
    found, _ = told(lambda t: min(speed * max(t - 0.2, 0.0), 0.15))
    assert "arm_left_2_joint is held" in found[0]


def test_a_joint_that_overshot_and_stays_there_met_somebody() -> None:
    found, _ = told(lambda t: 0.1 * (1.0 - np.exp(-15.0 * t)))
    assert "arm_left_2_joint is held" in found[0]


@pytest.mark.parametrize(
    ("name", "mode", "seed", "rate", "lasts"),
    [
        ("alex", Mode.POSITION, 3, 200.0, 3.0),
        ("talos", Mode.VELOCITY, 7, 500.0, 5.1),
        ("nao", Mode.POSITION, 20, 100.0, 10.1),
    ],
)
def test_a_healthy_robot_at_the_limits_of_its_motors_met_nobody(
    name: str, mode: Mode, seed: int, rate: float, lasts: float
) -> None:
    """Alex' arms throw its spine 5 degrees beyond its reference, and the damping of Talos' gripper takes 0.9
    of its torque: with a servo of 7 rad/s it turned 0.2 s late. A NAO's shoulder pushes its elbow ahead; it
    then waits until its reference has come past it."""
    trial = Healthy(load_robot(name), mode, seed, rate=rate)
    trial.run(lasts)
    assert not trial.alarms
    assert trial.moved > 3.0, "a robot that stands still shows nothing"


def test_an_arm_accelerates_as_its_load_permits() -> None:
    """A NAO that swings 0.5 kg as fast as its empty hand overshoots by 5 degrees."""
    robot = load_robot("nao")
    servo = next(one.index for one in robot.servos if one.name == "LShoulderPitch")
    gate, now = Gate(robot, period=PERIOD, stale_after=0.05), 0.0
    here, most = np.zeros(len(robot.servos)), list[float]()
    for mass, goal in ((0.0, 0.5), (0.5, 1.0), (0.0, 0.5)):
        gate.load("left_arm", mass)
        orders, speeds = [position_command([servo], [goal])], [0.0]
        for _ in range(300):
            safe = gate.step(orders, reading(here, now), now)
            here[safe.servos], speeds = safe.position, [*speeds, float(safe.velocity[0])]
            orders, now = [], now + PERIOD
        most.append(float(np.abs(np.diff(speeds)).max()) / PERIOD)
    assert most[1] < 0.4 * most[0]
    assert most[2] == pytest.approx(most[0])
