"""Identifies the friction of a joint by slow sweeps in both directions, at two speeds.

The torque of friction changes its sign with the direction of motion. Wrong masses in the model cause a torque
error that has equal signs in both directions, so this error cancels in the difference between the two
directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.gate.gate import GateState
from tci.lab.commissioning.operator import Operator
from tci.messages import JointReading, Mode, PlatformCommand
from tci.messages.frames import Array
from tci.robot.description import Robot, Servo
from tci.robot.dynamics import Dynamics
from tci.robot.joint_calibration import JointCalibration, JointFriction, joint_calibration
from tci.robot.json_file import write_json
from tci.robot.kinematics import KinematicChain
from tci.runtime.control import Control
from tci.runtime.watchdogs import missed_periods

SPAN = float(np.deg2rad(10.0))
"""Angle [rad] of a sweep. Assumed: larger than the angle between two teeth of a gear."""
SPEEDS = tuple(np.deg2rad([5.0, 20.0]).tolist())
"""Speeds [rad/s] of the two sweeps. Assumed: so slow that inertia is negligible, and so different that dry
and viscous friction can be distinguished."""
STEADY = 0.7
"""Least speed of the samples in the fit, as a fraction of the commanded speed. Assumed: in slower samples the
joint accelerates or sticks."""
PATIENCE = 5.0
"""Longest time [s] after the planned end of a sweep to wait until the servo has arrived. After this time, the
sweep has failed."""
LEAST = 20
"""Least number of samples in each direction of each sweep. Assumed: enough samples to average the noise of
the measured motor currents."""


class FrictionSweeps:
    """Sweeps one servo after another, if the operator gives permission, and stores the measured friction."""

    def __init__(self, control: Control, operator: Operator, calibration: JointCalibration) -> None:
        """Prepares the sweeps. The computed torques include the tools and rotors in the present
        `calibration`. Raises the errors of `Dynamics`."""
        self.control, self.driver, self.operator = control, control.driver, operator
        self.calibration = calibration
        """Calibration with the friction of all servos that were measured so far."""
        self._dynamics = Dynamics(control.driver.robot, calibration)

    def sweep(self, servo: Servo) -> Finding:
        """Sweeps one servo in both directions at each of `SPEEDS`, and computes the friction of the servo."""
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
        """Moves a servo to `target` [rad].

        Returns the readings during the motion, and the reason for an early end of the motion. The reason is
        empty if the servo arrived.
        """
        seen = list[JointReading]()
        command = PlatformCommand(
            Mode.POSITION, np.array([servo.index]), np.array([target]), np.array([speed])
        )
        pending = [command]
        for moment in self.control.periods(duration=SPAN / speed + PATIENCE):
            joints = moment.reading.joints
            safe = self.control.act(pending)
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
    """Measures the friction of those `servos` whose torques are used to detect touches, and writes the
    friction to a file. The file also contains all other values of the robot's present calibration, unchanged.
    Raises the errors of `joint_calibration`, `Dynamics` and `write_json`.
    """
    robot = driver.robot
    control = Control(driver, who="the friction sweeps", watchdogs=[missed_periods])
    sweeps = FrictionSweeps(control, operator, joint_calibration(robot))
    feeling = feeling_servos(robot, KinematicChain(robot))
    with control:
        found = tuple(sweeps.sweep(servo) for servo in servos if servo in feeling)
    when = datetime.now(UTC).isoformat(timespec="seconds")
    write_json(file, sweeps.calibration.model_copy(update={"date": when}))
    return found


def feeling_servos(robot: Robot, kinematics: KinematicChain) -> list[Servo]:
    """Returns the servos whose torques are used to detect touches on patches without taxels. These servos are
    all servos of the robot parts that carry these patches.
    """
    felt = [patch.link for patch in robot.patches if patch.through_joints]
    boards = {robot.servos[servo].robot_part for link in felt for servo in kinematics.chain(link)}
    return [one for one in robot.servos if one.robot_part in boards and one.joint is not None]


def steady(seen: Sequence[JointReading], servo: int, speed: float) -> list[JointReading]:
    """Returns the readings in which a servo moves at about `speed` [rad/s] in either direction and reports a
    torque.
    """
    return [
        one
        for one in seen
        if one.torque is not None
        and np.isfinite(one.torque[servo])
        and STEADY * speed < abs(one.velocity[servo]) < speed / STEADY
    ]


def identify(seen: Sequence[JointReading], servo: int, dynamics: Dynamics) -> JointFriction:
    """Computes dry and viscous friction of a servo from readings of steady motions, by least squares. The fit
    also has a constant torque and a torque proportional to the angle, to compensate for errors of the model's
    masses.
    """
    rows, torques = [], []
    for one in seen:
        assert one.torque is not None  # `steady` returns only readings with torques
        _, bias = dynamics.at(one.position, one.velocity)
        speed = one.velocity[servo]
        rows.append((np.sign(speed), speed, 1.0, one.position[servo]))
        torques.append(one.torque[servo] - bias[servo])
    found: Array = np.linalg.lstsq(np.array(rows), np.array(torques), rcond=None)[0]
    coulomb, viscous = np.maximum(found[:2], 0.0).tolist()
    return JointFriction(coulomb=coulomb, viscous=viscous)
