"""The control of the motors changes without a step of weights, targets or gains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tci.messages import JointReading
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.wires.unitree.driver import slots_of
from tci.wires.unitree.handover import DAMPED, GIVE, QUIET, TAKE, Handover, Phase, holding
from tci.wires.unitree.motors import ARM_GAINS, MOTORS, TARGET, gains
from tci.wires.unitree.set_points import SetPoints

PERIOD = 0.004
HERE = np.linspace(-1.0, 1.0, MOTORS)


def leading(*, whole: bool = False) -> tuple[Handover, float]:
    """Returns a handover whose ramp has ended, and the time."""
    handover, now = Handover(gains(whole=whole), whole=whole), 10.0
    handover.take(HERE, now)
    while handover.phase is Phase.TAKING:
        now += PERIOD
        handover.step(now)
    return handover, now


def order(value: float, *, stiff: bool = True) -> NDArray[np.void]:
    targets = np.zeros(MOTORS, TARGET)
    targets["q"] = targets["dq"] = targets["tau"] = value
    if stiff:
        targets["kp"], targets["kd"] = ARM_GAINS["kp"], ARM_GAINS["kd"]
    return targets


def pushes(sent: NDArray[np.void]) -> bool:
    return bool(sent["dq"].any() or sent["tau"].any())


ALL = np.ones(MOTORS, dtype=bool)


def test_the_weight_rises_in_a_second_at_the_posture() -> None:
    handover, now = Handover(ARM_GAINS, whole=False), 10.0
    handover.take(HERE, now)
    weights = []
    while handover.phase is Phase.TAKING:
        now += PERIOD
        sent = handover.step(now)
        weights.append(handover.weight)
        handover.follow(ALL, order(0.3), HERE, now)  # too early
        assert (sent["q"] == HERE).all()
        assert not pushes(sent)
    assert now - 10.0 == pytest.approx(TAKE, abs=PERIOD)
    assert np.diff(weights).max() <= PERIOD / TAKE + 1e-9


def test_targets_of_chosen_motors_are_followed_and_others_stay() -> None:
    handover, now = leading()
    chosen = np.arange(MOTORS) == 18
    handover.follow(chosen, order(0.5), HERE, now)
    sent = handover.step(now + PERIOD)
    assert sent[18].tolist()[:3] == (0.5, 0.5, 0.5)
    assert (sent["q"][~chosen] == HERE[~chosen]).all()
    assert not pushes(sent[~chosen])


def test_the_weight_falls_in_two_seconds_while_targets_stay() -> None:
    handover, now = leading()
    handover.follow(ALL, order(0.5), HERE, now)
    handover.give()
    begin, weights = now, [handover.weight]
    while handover.phase is Phase.GIVING:
        now += PERIOD
        sent = handover.step(now)
        handover.follow(ALL, order(-0.5), HERE, now)  # too late
        weights.append(handover.weight)
        assert (sent["q"] == 0.5).all()
        assert not pushes(sent)
    assert now - begin == pytest.approx(GIVE, abs=PERIOD)
    assert weights[-1] == 0.0
    assert -np.diff(weights).min() <= PERIOD / GIVE + 1e-9


def test_a_process_that_stood_still_does_not_jump() -> None:
    handover = Handover(ARM_GAINS, whole=False)
    handover.take(HERE, 10.0)
    handover.step(15.0)
    assert handover.weight < 0.05
    handover, now = leading()
    handover.give()
    handover.step(now + 5.0)
    assert handover.weight > 0.95


def test_an_old_ramp_is_never_resumed() -> None:
    handover, now = leading()
    handover.follow(ALL, order(0.5), HERE, now)
    handover.give()
    handover.step(now + 0.004)
    handover.take(HERE, now + 0.008)  # still being given
    assert handover.phase is Phase.GIVING
    handover.give_unseen(HERE, HERE + 0.3 * np.sign(HERE - 0.5))  # away from the targets
    assert (handover.step(now + 0.012)["q"] == HERE + 0.3 * np.sign(HERE - 0.5)).all()
    while handover.phase is not Phase.WAITING:
        handover.step(now := now + PERIOD)
    handover.take(HERE / 2, now)
    sent = handover.step(now + PERIOD)
    assert handover.weight <= PERIOD / TAKE + 1e-9
    assert (sent["q"] == HERE / 2).all()


def test_targets_stay_for_motors_that_have_not_left_them_unseen() -> None:
    handover, now = leading()
    handover.follow(ALL, order(0.5), HERE, now)
    sagging, seen = np.full(MOTORS, 0.42), np.full(MOTORS, 0.43)
    seen[20], seen[21] = 0.25, 0.5  # pushed away from the target, and moved back to the target
    handover.give_unseen(sagging, seen)
    assert handover.phase is Phase.GIVING
    sent = handover.step(now + PERIOD)["q"]
    assert sent[20] == 0.25
    assert (np.delete(sent, 20) == 0.5).all()


def test_velocities_and_torques_end_when_targets_stop() -> None:
    handover, now = leading()
    torque = order(0.4, stiff=False)
    handover.follow(ALL, torque, HERE, now)
    assert (handover.step(now + PERIOD)["tau"] == 0.4).all()
    late = handover.step(now + QUIET + PERIOD)
    assert not pushes(late)
    assert (late["kd"] == ARM_GAINS["kd"]).all()


@pytest.mark.parametrize("whole", [False, True])
def test_what_holds_the_weight_comes_with_the_stiffness_and_goes_with_it(whole: bool) -> None:
    handover, now = Handover(gains(whole=whole), whole=whole), 10.0
    handover.take(HERE, now, 2.0)
    first = handover.step(now + PERIOD)["tau"]
    assert (first < 0.1).all() if whole else (first == 2.0).all(), "over rt/arm_sdk the robot weights it"
    handover, now = leading(whole=whole)
    targets = holding(HERE, gains(whole=whole), 2.0)
    handover.follow(np.arange(MOTORS) < 20, targets, HERE, now)
    assert (handover.step(now + PERIOD)["tau"] == 2.0).all(), "of all motors, commanded or not"
    assert (handover.step(now + QUIET + PERIOD)["tau"] == 2.0).all(), "while nobody tells, too"
    handover.give()
    assert (handover.step(now + QUIET + 2.0 * PERIOD)["tau"] == (0.0 if whole else 2.0)).all()


@pytest.mark.parametrize("measured", [[0.0, 0.0, -1000.0], [0.0, 0.0, -1.0], [np.nan] * 3, [0.0, 0.0, 0.0]])
def test_an_accelerometer_that_is_wrong_multiplies_no_torque(measured: list[float]) -> None:
    robot = load_robot("g1")
    upright = JointReading(1.0, 0, np.array(initial_position(robot)), np.zeros(len(robot.servos)))
    found = [
        SetPoints(robot, slots_of(robot), whole=False).holds(replace(upright, gravity=gravity))
        for gravity in (np.array(measured), None)
    ]
    assert found[0] == pytest.approx(found[1], abs=1e-6)
    assert np.abs(found[1]).max() > 1.0, "arms weigh something"


def test_a_motor_under_torque_that_is_left_stays_where_it_is() -> None:
    handover, now = leading()
    torque = order(0.4, stiff=False)
    handover.follow(ALL, torque, HERE, now)
    chosen = np.arange(MOTORS) < 20
    handover.follow(chosen, order(0.1), HERE + 0.2, now)
    sent = handover.step(now + PERIOD)
    assert (sent["q"][20:] == HERE[20:] + 0.2).all()
    assert (sent[["kp", "kd"]][20:] == ARM_GAINS[20:]).all()
    assert not sent["tau"][20:].any()


def test_without_a_controller_of_its_own_stiffness_rises_and_damping_is_the_end() -> None:
    whole = gains(whole=True)
    handover, now = Handover(whole, whole=True), 10.0
    handover.take(HERE, now)
    sent = handover.step(now + PERIOD)
    assert (sent["kp"] < 0.01 * whole["kp"]).all()
    assert (sent["kd"] >= whole["kd"]).all()
    handover, now = leading(whole=True)
    assert (handover.step(now)["kp"] == whole["kp"]).all()
    handover.give()
    begin = now
    while handover.phase is Phase.GIVING:
        now += PERIOD
        sent = handover.step(now)
        assert not pushes(sent)
        assert not sent["kp"].any()
        assert (sent["kd"] > 0.0).all()
    assert now - begin == pytest.approx(DAMPED, abs=PERIOD)
