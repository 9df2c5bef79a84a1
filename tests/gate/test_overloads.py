"""A joint of which motion asks more than its motor has yields, and nobody holds it."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.healthy import Healthy
from tci.gate.contact.overloads import RETURNS, Overloads
from tci.gate.joint_monitor import Reference
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.clearance import without_skin
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration

G1 = load_robot("g1")
SHOULDERS = np.array([s.index for s in G1.servos if s.name.endswith("shoulder_pitch_joint")])
WAIST = next(s.index for s in G1.servos if s.name == "waist_pitch_joint")
HERE = np.zeros(len(G1.servos))
RAISED = -3.0
BEHIND = np.ones(len(G1.servos))


def _swung(acceleration: float) -> tuple[Overloads, Array]:
    """After 0.1 s in which both of a G1's raised arms accelerate [rad/s2], with the times [s]."""
    found = Overloads(G1)
    found.load(Dynamics(without_skin(G1), JointCalibration(robot="g1")))
    times = np.arange(11) * 0.01
    for now in times.tolist():
        position = np.full(2, RAISED + 0.5 * acceleration * now**2)
        speed = np.full(2, acceleration * now)
        found.remember(Reference(SHOULDERS, (Mode.POSITION,) * 2, position, speed, np.zeros(2)), HERE, now)
    return found, times


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_waist_yields_to_arms_that_ask_more_than_it_has(way: float) -> None:
    asked, times = _swung(100.0 * way)
    now = float(times[-1])
    behind = [side for side in (1.0, -1.0) if asked.yields(side * BEHIND, now)[WAIST]]
    assert len(behind) == 1, "it lacks torque in one direction only"
    assert asked.yields(behind[0] * BEHIND, now + 0.9 * RETURNS)[WAIST]
    assert not asked.yields(behind[0] * BEHIND, now + 1.1 * RETURNS)[WAIST], "it must have turned"
    other, _ = _swung(-100.0 * way)
    assert other.yields(-behind[0] * BEHIND, now)[WAIST]


def test_a_waist_yields_to_nothing_while_arms_ask_what_it_has() -> None:
    gentle, times = _swung(10.0)
    assert not gentle.yields(BEHIND, float(times[-1])).any()
    assert not gentle.yields(-BEHIND, float(times[-1])).any()


@pytest.mark.parametrize(("mode", "lasts"), [(Mode.POSITION, 5.4), (Mode.VELOCITY, 3.7)])
def test_a_waist_that_arms_throw_aside_met_nobody(mode: Mode, lasts: float) -> None:
    """Arms at full speed throw a G1's waist 6 and 13 degrees aside."""
    trial = Healthy(G1, mode, 5, rate=100.0)
    trial.run(lasts)
    assert not trial.alarms
