"""The keeper is the process that controls the motors. Tests the commands that a robot receives from the
keeper after faults of the behaviour."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from typing import cast

import numpy as np
import pytest

import tci
from helpers import HELPERS
from helpers.dds_domains import DOMAINS
from helpers.motor_holder import held_motors
from helpers.puppets import Puppet
from tci.drivers.diagnosis import Level
from tci.errors import DriverError
from tci.gate.safe_command import GateState
from tci.lab.commissioning.hardware import ServoCheck
from tci.lab.commissioning.operator import Operator
from tci.messages import Mode, PlatformCommand
from tci.reasons import Code
from tci.runtime.control import Control
from tci.shared.interface_node import InterfaceNode
from tci.wires.unitree import messages
from tci.wires.unitree.driver import UnitreeDriver
from tci.wires.unitree.handover import GIVE, LONGEST, TAKE, Phase, holding
from tci.wires.unitree.held_motors import HeldMotors
from tci.wires.unitree.motors import ARM_GAINS, MOTORS

pytestmark = pytest.mark.timeout(60)
ALL = np.ones(MOTORS, dtype=bool)
STEP = 3 * LONGEST
"""Largest accepted time [s] between two received weights. On a busy machine some messages are lost."""


@pytest.fixture
def domain() -> int:
    """Returns a DDS domain that no other test uses."""
    return next(DOMAINS)


@pytest.fixture
def puppet(domain: int) -> Iterator[Puppet]:
    with Puppet(domain) as robot:
        yield robot


def hold(domain: int) -> HeldMotors:
    return held_motors(f"lo/{domain}", 0.004)


def lead(held: HeldMotors, angle: float, seconds: float) -> None:
    targets = holding(np.full(MOTORS, angle), ARM_GAINS)
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        held.follow(ALL, targets)
        held.poll()
        time.sleep(0.004)


def largest_steps(puppet: Puppet) -> tuple[float, float]:
    """Returns the largest increase and the largest decrease of the weight between two commands."""
    change = np.diff([0.0, *puppet.weights])
    return float(change.max()), -float(change.min())


def test_motors_are_taken_and_handed_back_slowly(domain: int, puppet: Puppet) -> None:
    with closing(hold(domain)) as held:
        held.wait()
        posture = puppet.state["motor"]["q"][12:29]
        assert all((heard.motor["q"][12:29] == posture).all() for heard in puppet.heard)
        lead(held, 0.3, 0.2)
    assert puppet.weights[-1] == 0.0
    rise, fall = largest_steps(puppet)
    assert rise <= STEP / TAKE
    assert fall <= STEP / GIVE
    full = max(place for place, weight in enumerate(puppet.weights) if weight == 1.0)
    falling = [heard for heard in puppet.heard[full:] if heard.weight > 0.0]
    assert falling[-1].time - falling[0].time == pytest.approx(GIVE, abs=0.6)
    assert all((heard.motor["q"][12:29] == np.float32(0.3)).all() for heard in falling)
    assert {heard.mode_machine for heard in puppet.heard} == {5}
    assert all(heard.right for heard in puppet.heard)
    assert not any(heard.motor["mode"][:12].any() for heard in puppet.heard)  # the legs


def test_a_behaviour_that_is_killed_leaves_a_completed_fade(domain: int, puppet: Puppet) -> None:
    command = [sys.executable, str(HELPERS / "motor_holder.py"), str(domain), "0.004"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert [holder.stdout.readline() for _ in range(2)] == ["asked\n", "holding\n"]
        holder.kill()
    killed = time.monotonic()
    puppet.wait(lambda robot: robot.weights[-1] == 0.0)
    assert puppet.heard[-1].time - killed == pytest.approx(GIVE, abs=0.6)
    assert largest_steps(puppet)[1] <= STEP / GIVE
    assert puppet.heard[-1].motor["q"][20] == np.float32(0.3)
    assert not puppet.heard[-1].motor["dq"].any()  # the keeper was killed during a motion


def test_a_keeper_that_is_killed_is_noticed_and_the_behaviour_completes_its_fade(
    domain: int, puppet: Puppet
) -> None:
    with tci.connect("g1", f"unitree:lo/{domain}", arm=True) as driver:
        assert isinstance(driver, UnitreeDriver)
        puppet.obeys = True
        arm = driver.native("left_arm")
        orders = [arm.command({"left_elbow_joint": 0.4})]
        for count, now in enumerate(driver.ticks(duration=5.0)):
            sent = driver.write(driver.gate.step(orders, driver.read().joints, now))
            orders = []
            if count > 20 and np.abs(sent.velocity).max() < 1e-9:
                break  # during a motion, the set-point differs from the last one that the robot received
        time.sleep(0.05)
        assert sent.state is GateState.RUN, sent.reason
        assert driver._held is not None
        os.kill(driver._held._process.pid, signal.SIGKILL)
        killed = time.monotonic()
        before = len(puppet.heard)
        goal = puppet.heard[-1].motor["q"][18]
        while driver.gate.step([], driver.read().joints, driver.clock.now()).state is not GateState.STOP:
            assert time.monotonic() - killed < 0.1
            time.sleep(0.004)
        assert "was killed, and this one fades them out" in str(driver.gate.reason)
    fade = puppet.heard[before:]
    assert fade[0].time - killed < 0.1
    assert puppet.weights[-1] == 0.0
    assert largest_steps(puppet)[1] <= STEP / GIVE
    assert fade[-1].time - killed == pytest.approx(GIVE, abs=0.6)
    assert all(heard.motor["q"][18] == goal for heard in fade)  # the elbow
    assert all(heard.right and heard.mode_machine == 5 for heard in fade)


def test_legs_are_refused_by_name_and_the_rest_goes_on(domain: int, puppet: Puppet) -> None:
    puppet.state["accelerometer"] = 1.0, 0.0, 9.0
    with tci.connect("g1", f"unitree:lo/{domain}") as driver:
        gravity = driver.read().joints.gravity
        assert gravity is not None
        assert gravity.tolist() == [-1.0, 0.0, -9.0]
        legs = driver.robot.servos_of("left_leg")
        knee = PlatformCommand(Mode.POSITION, np.array([legs[3].index]), np.array([0.3]), np.array([0.5]))
        elbow = driver.native("left_arm").command({"left_elbow_joint": 0.3}, speed=0.5)
        sent = driver.gate.step([knee, elbow], driver.read().joints, driver.clock.now())
        assert sent.state is GateState.RUN
        assert [refusal.code for refusal in sent.refusals] == [Code.ROBOT_REFUSES]
        assert "left_knee_joint can't be moved: rt/arm_sdk moves waist and arms" in str(sent.refusals[0])
        assert sent.orders == (elbow,)
        check = ServoCheck(Control(driver), cast("Operator", None))
        found = [check.check(leg) for leg in legs]
    assert {finding.level for finding in found} == {Level.NOTE}
    assert all("rt/arm_sdk moves waist and arms" in finding.what for finding in found)


def test_a_variant_obeys_for_the_joints_that_it_has(domain: int, puppet: Puppet) -> None:
    puppet.state["mode_machine"] = 6  # this variant has no waist roll and no waist pitch
    with tci.connect("g1", f"unitree:lo/{domain}") as driver:
        waist = driver.robot.servos_of("torso")
        whole = PlatformCommand(
            Mode.POSITION, np.array([servo.index for servo in waist]), np.full(3, 0.1), np.full(3, 0.5)
        )
        sent = driver.gate.step(whole, driver.read().joints, driver.clock.now())
        assert not sent.refusals
        assert sent.servos.tolist() == [waist[0].index]
        roll = driver.native("torso").command({"waist_roll_joint": 0.1})
        sent = driver.gate.step(roll, driver.read().joints, driver.clock.now())
    assert "this robot has 27 motors, and not this one" in str(sent.refusals[0])


def test_states_that_stop_end_all_and_a_new_start_is_from_zero(domain: int, puppet: Puppet) -> None:
    with closing(hold(domain)) as held:
        held.wait()
        lead(held, 0.3, 0.1)
        puppet.silent, begin = True, time.monotonic()
        lead(held, -0.3, 0.15)
        lead(held, 0.2, 0.3)  # too late: the last state is older than 0.1 s
        assert held.poll().phase is Phase.GIVING
        assert "ms old" in held.status.reason
        assert puppet.heard[-1].time > begin + 0.4
        assert not any(heard.motor["q"][20] == np.float32(0.2) for heard in puppet.heard)
        puppet.state["motor"]["q"][:29] = 0.7
        puppet.state["motor"]["q"][21] = -0.25
        puppet.silent = False
        puppet.wait(lambda robot: robot.weights[-1] == 0.0)
        # the present position, so that there is no step
        assert puppet.heard[-1].motor["q"][20] == np.float32(0.7)
        # differs from the target because of the joint's load
        assert puppet.heard[-1].motor["q"][21] == np.float32(-0.3)
        puppet.state["motor"]["q"][21] = 0.7
        count = len(puppet.heard)
        lead(held, 0.1, 0.3)
        assert len(puppet.heard) - count <= 5  # repetitions of the last
        held.take()
        held.wait()
        again = puppet.heard[count + 5 :]
        assert max(np.diff([0.0, *(heard.weight for heard in again)])) <= STEP / TAKE
        assert all(heard.motor["q"][20] == np.float32(0.7) for heard in again)


def test_l2_and_b_hand_back_until_a_person_connects_again(domain: int, puppet: Puppet) -> None:
    with closing(hold(domain)) as held:
        held.wait()
        puppet.state["remote"][2:4] = 1 << 5, 1 << 1
        puppet.wait(lambda robot: held.poll().lasting)
        puppet.state["remote"][2:4] = 0, 0
        assert held.status.reason == "L2+B on the remote"
        puppet.wait(lambda robot: robot.weights[-1] == 0.0)
        count = len(puppet.heard)
        held.take()
        time.sleep(0.3)
        assert len(puppet.heard) - count <= 5
        assert held.poll().lasting
    with closing(hold(domain)) as held:
        held.wait()


def test_a_behaviour_that_hangs_loses_the_motors(domain: int, puppet: Puppet) -> None:
    with closing(hold(domain)) as held:
        held.wait()
        lead(held, 0.3, 0.1)
        puppet.wait(lambda robot: robot.weights[-1] < 1.0)
        puppet.wait(lambda robot: "has sent nothing for 1.0 s" in held.poll().reason)
        assert not held.status.lasting


@pytest.mark.parametrize("fault", ["writer", "checksum", "motor"])
def test_a_robot_that_is_not_ready_is_not_taken(domain: int, puppet: Puppet, fault: str) -> None:
    other, writer = InterfaceNode("lo", domain), None
    word = {"writer": "another program writes rt/arm_sdk", "checksum": "no answer", "motor": "error 2"}[fault]
    if fault == "writer":
        writer = other.out("rt/arm_sdk", messages.COMMAND)
    elif fault == "checksum":
        puppet.spoilt = True
    else:
        puppet.state["motor"]["motorstate"][20] = 2
    with closing(other), closing(hold(domain)) as held:
        if fault == "checksum":
            puppet.wait(lambda robot: "wrong checksum" in held.poll().reason)
            time.sleep(0.7)  # the time of the search for other programs before the motors are taken
            assert held.poll().phase is Phase.WAITING
        else:
            with pytest.raises(DriverError, match=word):
                held.wait()
    assert not puppet.heard
    del writer
