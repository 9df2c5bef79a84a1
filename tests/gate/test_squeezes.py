"""People whom an arm squeezes by a withdrawal, in its elbow, or while something else stops the gate."""

from __future__ import annotations

from dataclasses import replace

import pytest

from helpers.squeezed import By, Outcome, Squeeze, squeeze
from helpers.squeezes import draw, draw_in_elbow
from tci.gate.contact.settings import ContactSettings
from tci.gate.settings import OVER_A_WIRE, GateSettings, over_a_wire
from tci.messages import Mode
from tci.robot.catalogue import load_robot

ALONE = GateSettings(contact=None)
STIFF = GateSettings(contact=ContactSettings(softens=False))
"""For servos that take no share of their stiffness."""


def freed(name: str, trial: Squeeze | None) -> Outcome:
    """The trial, after bars of the row `squeezed` were met, and are not met without the gate's answer."""
    assert trial is not None
    robot = load_robot(name)
    before, after = squeeze(robot, trial, settings=ALONE), squeeze(robot, trial)
    assert before.late > (15.0 if before.felt else 30.0), "this trial shows nothing"
    assert after.half <= 65.0
    assert after.over <= 0.2
    assert after.late <= (15.0 if after.felt else 30.0)
    return after


def test_a_withdrawal_does_not_leave_a_bystander_squeezed() -> None:
    robot = load_robot("icub")
    freed("icub", draw(robot, 10, by="reflex"))


@pytest.mark.parametrize(
    ("name", "seed", "by", "stops"), [("icub", 3, "reflex", None), ("talos", 10, "order", 0.363)]
)
def test_whom_an_arm_meets_while_it_accelerates_or_brakes_is_not_left_pressed(
    name: str, seed: int, by: By, stops: float | None
) -> None:
    """53 N and 86 N were left for ever: of somebody who was met then no later torque told."""
    robot = load_robot(name)
    trial = replace(draw(robot, seed, by=by, below=by == "order"), stops=stops)
    after = squeeze(robot, trial)
    assert after.peak > 65.0, "this trial shows nothing"
    assert after.late <= 30.0


def test_whom_an_icub_squeezes_behind_a_wire_is_freed() -> None:
    """Its servos are stiff there, and bend by less than 6 degrees: 191 N were left for ever."""
    robot = load_robot("icub")
    trial = draw(robot, 9, by="gesture", below=True)
    after = squeeze(robot, trial, settings=OVER_A_WIRE, sways=True)
    assert after.peak > 65.0, "this trial shows nothing"
    assert after.over <= 0.2
    assert after.late <= 15.0


def test_whom_a_stiff_arm_holds_without_skin_and_torques_is_freed_once_nothing_lags_any_more() -> None:
    """A NAO as it is sold, behind a wire: 37 N were left for ever, which bend a joint by 4.4 degrees."""
    robot = load_robot("nao-plain")
    trial = draw_in_elbow(robot, 38, by="order")
    assert trial is not None
    after = squeeze(robot, trial, settings=OVER_A_WIRE, sways=True)
    assert after.peak > 50.0, "this trial shows nothing"
    assert after.late <= 30.0


def test_somebody_in_the_elbow_of_an_arm_that_moves_leads_nobody() -> None:
    """In a lesson, which handles contact: torques told of them first, then both sides of the elbow felt
    them, as they feel a hand that leads. 74 N were left for ever."""
    robot = load_robot("g1")
    trial = draw_in_elbow(robot, 2, by="gesture")
    assert trial is not None
    after = squeeze(robot, replace(trial, by="lesson"), settings=over_a_wire(softens=True), sways=True)
    assert after.peak > 65.0, "this trial shows nothing"
    assert after.late <= 15.0


@pytest.mark.parametrize(("name", "seed"), [("talos", 19), ("icub", 3)])
def test_torques_tell_while_references_accelerate_and_brake(name: str, seed: int) -> None:
    """By four times what any acceleration takes in any posture, they told after references rested: 0.26 and
    0.2 s above 65 N."""
    after = squeeze(load_robot(name), draw(load_robot(name), seed, by="reflex"))
    assert after.peak > 65.0, "this trial shows nothing"
    assert after.over <= 0.12


def test_whom_skin_told_of_does_not_hide_a_second_person_from_torques() -> None:
    """40 N were left on them, and 126 N stood for 0.4 s while weak torques told where the first was."""
    robot = load_robot("icub")
    trial = replace(draw(robot, 14, below=True), stops=0.096)
    after = squeeze(robot, trial, behind=0.01735, settings=STIFF)
    assert after.other.peak > 65.0, "the second must be met"
    assert after.other.over <= 0.2
    assert max(after.late, after.other.late) <= 15.0


def test_whom_a_soft_arm_strikes_is_no_weight_that_it_sinks_by() -> None:
    """The reflex makes its arm softer, and meets them within the second in which a soft joint sinks."""
    freed("g1", draw(load_robot("g1"), 1, mode=Mode.IMPEDANCE, by="reflex"))


@pytest.mark.parametrize("name", ["nao", "g1"])
def test_an_elbow_opens_again(name: str) -> None:
    trial = draw_in_elbow(load_robot(name), 2)
    after = freed(name, trial)
    assert after.felt


def test_a_stop_for_another_cause_frees_too() -> None:
    after = freed("icub", replace(draw(load_robot("icub"), 1), stops=0.01))
    assert after.state == "STOP"
    assert after.said[-1] == "another cause"


def test_a_stiff_servo_whose_stream_is_cut_after_the_first_order_presses_on() -> None:
    """That order makes a servo soft that can be soft."""
    robot, trial = load_robot("icub"), draw(load_robot("icub"), 1)
    assert squeeze(robot, trial, cut=True, settings=STIFF).late > 30.0
    assert squeeze(robot, trial, cut=True).late <= 30.0


@pytest.mark.parametrize(("name", "seed", "below"), [("talos", 18, True), ("g1", 6, True)])
def test_an_arm_that_goes_back_does_so_softly(name: str, seed: int, below: bool) -> None:
    """A reference runs on while it brakes, and a stiff servo presses with its full torque meanwhile: 0.2 to
    0.4 s above 65 N."""
    robot, trial = load_robot(name), draw(load_robot(name), seed, below=below)
    assert squeeze(robot, trial, settings=STIFF).over > 0.2, "this trial shows nothing"
    freed(name, trial)


def test_an_arm_that_gets_its_stiffness_back_does_not_press_again() -> None:
    """Its reference had stopped 0.2 degrees inside them: nothing while it was soft, 47 N afterwards."""
    trial = draw_in_elbow(load_robot("talos"), 0, by="gesture")
    assert trial is not None
    freed("talos", replace(trial, by="lesson"))


def test_whoever_is_met_late_is_watched_for_two_seconds() -> None:
    """The trial ended before, and they counted as freed."""
    robot = load_robot("nao")
    met = squeeze(robot, replace(draw(robot, 1, by="gesture"), share=0.2), settings=ALONE)
    assert met.first is not None
    assert met.first > 1.5
    assert met.late > 15.0
