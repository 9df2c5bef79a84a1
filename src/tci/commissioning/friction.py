"""Identifies the friction of a joint by two slow sweeps: there and back, at two speeds.

Errors of the model's masses are the same on the way there and back, so they cancel; friction changes its
sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tci.commissioning.operator import Operator
from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.frames import Array
from tci.gate.gate import GateState
from tci.messages import JointReading, Mode, PlatformCommand
from tci.robot.description import Robot, Servo
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration, JointFriction, joint_calibration
from tci.robot.json_file import write_json
from tci.robot.kinematics import KinematicChain
from tci.runtime.lease import commanding

SPAN = float(np.deg2rad(10.0))
"""Length [rad] of a sweep. Assumed: longer than the pattern of a gear's teeth."""
SPEEDS = tuple(np.deg2rad([5.0, 20.0]).tolist())
"""Speeds [rad/s] of the two sweeps. Assumed: slow enough that inertia does not count, and apart enough to
tell dry from viscous friction."""
STEADY = 0.7
"""Least fraction of the commanded speed of a sample. Assumed: slower ones accelerate or stick."""
PATIENCE = 5.0
"""Time [s] beyond that of a sweep after which it has failed."""
LEAST = 20
"""Least number of samples in each direction of each sweep. Assumed: noise of currents averages out."""


class FrictionSweeps:
    """Sweeps one servo after another, if the operator permits it, and keeps what was found."""

    def __init__(self, driver: Driver, operator: Operator, calibration: JointCalibration) -> None:
        """Takes the `calibration` so far, whose tools and rotors count. Raises what `Dynamics` raises."""
        self.driver, self.operator = driver, operator
        self.calibration = calibration
        """Calibration with the friction found so far."""
        self._dynamics = Dynamics(driver.robot, calibration)

    def sweep(self, servo: Servo) -> Finding:
        """Sweeps one servo there and back at each of `SPEEDS`, and identifies its friction."""
        limits, here = servo.limits, float(self.driver.read().joints.position[servo.index])
        if limits.lower is None or limits.upper is None or limits.upper - limits.lower < 2.0 * SPAN:
            return Finding(Level.NOTE, servo.name, "friction not measured: its limits leave no room")
        there = here + (SPAN if 0.5 * (limits.lower + limits.upper) >= here else -SPAN)
        words = f"sweep {servo.name} by {np.rad2deg(there - here):+.0f} degrees and back, twice, slowly"
        if not self.operator.may(words):
            return Finding(Level.NOTE, servo.name, "friction not measured: the operator did not permit it")
        samples: list[list[JointReading]] = []
        for speed in SPEEDS:
            for target in (there, here):
                seen, reason = self._move(servo, target, speed)
                samples.append(steady(seen, servo.index, speed))
                if reason:
                    return Finding(Level.FAULT, servo.name, f"friction not measured: {reason}")
        if min(map(len, samples)) < LEAST:
            advice = "its driver must report torques and speeds; a joint that sticks needs more stiffness"
            words = "friction not measured: too few samples with a torque in a steady motion"
            return Finding(Level.FAULT, servo.name, words, advice)
        found = identify([one for part in samples for one in part], servo.index, self._dynamics)
        rotor = self.calibration.friction.get(servo.name, JointFriction()).rotor
        found = found.model_copy(update={"rotor": rotor})
        friction = {**self.calibration.friction, servo.name: found}
        self.calibration = self.calibration.model_copy(update={"friction": friction})
        figures = {"coulomb_nm": found.coulomb, "viscous_nms": found.viscous}
        words = f"friction {found.coulomb:.3f} N m and {found.viscous:.3f} N m s/rad"
        return Finding(Level.OK, servo.name, words, figures=figures)

    def _move(self, servo: Servo, target: float, speed: float) -> tuple[list[JointReading], str]:
        """Sends a servo to `target` [rad]; returns what was read, and the reason for an early end, if any."""
        driver, seen = self.driver, list[JointReading]()
        command = PlatformCommand(
            Mode.POSITION, np.array([servo.index]), np.array([target]), np.array([speed])
        )
        pending = [command]
        for now in driver.ticks(duration=SPAN / speed + PATIENCE):
            joints = driver.read().joints
            safe = driver.write(driver.gate.step(pending, joints, now))
            if safe.state is GateState.STOP or safe.refusals:
                return seen, f"the gate ended it: {safe.reason or safe.refusals[0]}"
            pending = [command] if safe.state is GateState.HOLD else []
            if not seen or joints.stamp > seen[-1].stamp:
                seen.append(joints)
            if abs(joints.position[servo.index] - target) < 0.02 * SPAN:
                return seen, ""
        return seen, "it did not arrive"


def measure_friction(
    driver: Driver, operator: Operator, servos: Sequence[Servo], file: Path
) -> tuple[Finding, ...]:
    """Sweeps those of `servos` through which the robot feels touches, and writes their friction into a file.

    The calibration that the robot has so far stays otherwise. Raises what `joint_calibration`, `Dynamics` and
    `write_json` raise.
    """
    robot = driver.robot
    sweeps = FrictionSweeps(driver, operator, joint_calibration(robot))
    feeling = feeling_servos(robot, KinematicChain(robot))
    with commanding(driver):
        found = tuple(sweeps.sweep(servo) for servo in servos if servo in feeling)
    when = datetime.now(UTC).isoformat(timespec="seconds")
    write_json(file, sweeps.calibration.model_copy(update={"date": when}))
    return found


def feeling_servos(robot: Robot, kinematics: KinematicChain) -> list[Servo]:
    """Returns the servos through which a robot feels touches: those of the robot parts that carry a patch
    without taxels."""
    felt = [patch.link for patch in robot.patches if patch.through_joints]
    boards = {robot.servos[servo].robot_part for link in felt for servo in kinematics.chain(link)}
    return [one for one in robot.servos if one.robot_part in boards and one.joint is not None]


def steady(seen: Sequence[JointReading], servo: int, speed: float) -> list[JointReading]:
    """Returns the readings with a torque in which a servo moves at `speed` [rad/s], either way."""
    return [
        one
        for one in seen
        if one.torque is not None
        and np.isfinite(one.torque[servo])
        and STEADY * speed < abs(one.velocity[servo]) < speed / STEADY
    ]


def identify(seen: Sequence[JointReading], servo: int, dynamics: Dynamics) -> JointFriction:
    """Returns dry and viscous friction of a servo from readings of steady motions, by least squares.

    Beside friction the fit has a torque that changes linearly with the angle: the error of the model's
    masses.
    """
    rows, torques = [], []
    for one in seen:
        assert one.torque is not None  # steady
        _, bias = dynamics.at(one.position, one.velocity)
        speed = one.velocity[servo]
        rows.append((np.sign(speed), speed, 1.0, one.position[servo]))
        torques.append(one.torque[servo] - bias[servo])
    found: Array = np.linalg.lstsq(np.array(rows), np.array(torques), rcond=None)[0]
    coulomb, viscous = np.maximum(found[:2], 0.0).tolist()
    return JointFriction(coulomb=coulomb, viscous=viscous)
