"""Moves one servo after another slowly by 2 degrees, and asks the operator if the motion was right. If the
description has a wrong sign, zero, unit or assignment for both the command and the encoder of a servo, the
encoder can't show the fault. Therefore the check asks the operator which link moved. Every command passes the
gate, which checks the command before the driver sends the command. As soon as the check detects a wrong
motion, the check calls the robot's own stop function (`Driver.halt`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.gate.gate import GateState
from tci.lab.commissioning.expected_motion import expected_motion
from tci.lab.commissioning.operator import Operator
from tci.messages import Mode, PlatformCommand
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot, Servo
from tci.robot.kinematics import KinematicChain
from tci.runtime.control import Control

MOST = float(np.deg2rad(2.0))
"""Largest permitted motion [rad] of any servo. Assumed: a motion of this angle is visible, and too small to
cause harm."""
STEPS = np.deg2rad([0.03, 0.1, 0.3, 1.0, 1.8])
"""Successive displacements [rad] of a servo from its start. The first displacement is so small that the
motion stays below the permitted 2 degrees even if a wrong unit (degrees used as radians) makes the motion 57
times larger. The last displacement is below 2 degrees too, since the servo may overshoot."""
SPEED = float(np.deg2rad(4.0))
"""Speed [rad/s] of the motions, 2 degrees in half a second. Assumed: slow enough that the operator can watch
the motion."""
LEANS = float(np.deg2rad(0.1))
"""Largest angle [rad] beyond a limit that counts as inside. Assumed: a joint that rests on its stop, or whose
encoder rounds, reads at most this angle outside."""
SETTLE = 0.3
"""Time [s] from the end of a motion to the measurement of the angles. Assumed: oscillations have decayed
after this time."""
ARRIVE = 8.0
"""Longest duration [s] of one motion of a servo; after this time the servo counts as not arrived. Assumed:
far longer than the half second of a normal motion."""
HOLDS = 2.0
"""Longest total time [s] for which the gate may hold the robot during one step. Assumed: short holds, such as
a hold after a late frame, are harmless."""
STRAY = float(np.deg2rad(0.4))
"""Angle [rad] of a wrong motion above which a step ends early. A motion is wrong if another servo moves, or
if the tested servo moves in the wrong direction. Assumed: larger than the backlash of NAO's joints."""
RATIO = (0.6, 1.4)
"""Least and largest ratio of measured motion to commanded motion of a healthy servo. Assumed: in a motion of
2 degrees, backlash and sag cause an error of up to 40 %."""
UNIT = 180.0 / np.pi
ADVICE = {
    Code.MOVED_WRONG_WAY: "command and encoder have opposite signs: correct the robot's driver",
    Code.MOVED_TOO_FAR: "a unit is wrong: degrees and radians differ by 57.3",
}
"""Advice to the operator if a motion ends early, by the code of the reason."""
ELSE = "check cables, and the order of joints in the binding, before anything else"
"""Advice to the operator for all codes that are not in ADVICE."""


class ServoCheck:
    """Moves one servo after another and compares each motion with the expected motion."""

    def __init__(self, control: Control, operator: Operator) -> None:
        self.control, self.driver, self.operator = control, control.driver, operator
        driver = control.driver
        self._kinematics = KinematicChain(driver.robot) if driver.robot.model is not None else None
        self._small: set[str] = set()
        # A way back relies on units and signs that are examined here, so a part that is held only stops.
        stop: dict[str, Literal["stop"]] = {part.name: "stop" for part in driver.robot.parts}
        if (contact := driver.gate.settings.contact) is not None:
            driver.gate.set_contact(replace(contact, answers=stop))
        self.largest = 0.0
        """Largest measured motion [rad] of any servo in this check."""

    def check(self, servo: Servo) -> Finding:
        """Moves one servo by a small angle and back, if the operator gives permission. Returns the
        finding."""
        limits = servo.limits
        if None in (limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.jerk):
            return Finding(Level.NOTE, servo.name, "not moved: its description lacks limits")
        if why := self.driver.info.unreached.get(servo.index):
            return Finding(Level.NOTE, servo.name, f"not moved: {why}")
        start, noise = self._at_rest()
        here = start[servo.index]
        assert limits.lower is not None
        assert limits.upper is not None
        if not limits.lower - noise - LEANS <= here <= limits.upper + noise + LEANS:
            return Finding(
                Level.FAULT, servo.name,
                f"not moved: its encoder reads {np.rad2deg(here):.1f} degrees, outside its limits "
                f"{np.rad2deg(limits.lower):.1f} .. {np.rad2deg(limits.upper):.1f}",
                "correct limits, zero, sign or unit in the description, or move it inside by hand",
            )  # fmt: skip
        way = 1.0 if 0.5 * (limits.lower + limits.upper) >= here else -1.0
        if min(limits.upper - here, here - limits.lower) < MOST and limits.upper - limits.lower < 2.0 * MOST:
            return Finding(Level.NOTE, servo.name, "not moved: its limits leave no room")
        expected = None
        if self._kinematics is not None:
            expected = expected_motion(self.driver.robot, self._kinematics, start, servo, way * STEPS[-1])
        what = f"{servo.name} by {np.rad2deg(way * STEPS[-1]):+.1f} degrees"
        if expected is not None:
            what += f"; {expected.words}"
        if not self.operator.may(f"move {what}"):
            return Finding(Level.NOTE, servo.name, "not moved: the operator did not permit it")
        moved, reason = self._out(servo, start, way, noise)
        if reason is None and self.driver.gate.state is not GateState.STOP:
            self._move(servo, here, way, start, noise)
            seen = self.operator.saw(f"It went there and back. Did you see that: {what}?", expected)
        else:
            seen = None
        return _verdict(self.driver.robot, servo, way * moved, reason, noise, seen)

    def _out(self, servo: Servo, start: Array, way: float, noise: float) -> tuple[Array, Reason | None]:
        """Moves a servo away from its angle in `start` (n,) [rad] in several steps, each farther from this
        angle. `way` (1 or -1) is the direction of the motion. Returns the total motion (n,) [rad] of all
        servos, and the reason for an early end. The reason is None if all steps were executed.
        """
        moved = np.zeros(len(start))
        here = start[servo.index]
        for index, step in enumerate(STEPS):
            offset = way * step
            moved, reason = self._move(servo, here + offset, way, start, noise)
            if reason is not None:
                return moved, reason
            own = moved[servo.index] * way
            if own > 3.0 * step + noise + np.deg2rad(0.2):
                self.control.halt()
                words = f"it moved {own / step:.0f} times as far as commanded"
                return moved, Reason(Code.MOVED_TOO_FAR, words)
            if index == 0 and servo.robot_part not in self._small:
                # If encoder and command have the same wrong unit, only a person can see the fault.
                if not self.operator.still(
                    f"{servo.name} was sent {np.rad2deg(step):.2f} degrees, too little to see"
                ):
                    words = "it moved visibly, many times as far as commanded"
                    return moved, Reason(Code.MOVED_TOO_FAR, words)
                self._small.add(servo.robot_part)
        return moved, None

    def _move(
        self, servo: Servo, target: float, way: float, start: Array, noise: float
    ) -> tuple[Array, Reason | None]:
        """Moves a servo to `target` [rad] and waits until the servo is at rest. `way` (1 or -1) is the
        direction of the motion from `start`. Returns the motion (n,) [rad] of all servos from `start`, and
        the reason for an early end. The reason is None if the servo arrived.
        """
        driver = self.driver
        target = float(np.clip(target, servo.limits.lower, servo.limits.upper))
        command = PlatformCommand(
            Mode.POSITION, np.array([servo.index]), np.array([target]), np.array([SPEED])
        )
        pending = [command]
        moved = np.zeros(len(start))
        rested: float | None = None
        held = 0
        others = np.arange(len(start)) != servo.index
        tail: list[Array] = []
        for moment in self.control.periods(duration=ARRIVE):
            now, reading = moment.now, moment.reading
            safe = self.control.act(pending)
            held += safe.state is GateState.HOLD
            if safe.state is GateState.STOP or held * driver.period > HOLDS:
                code = Code.OTHER if safe.reason is None else safe.reason.code
                return moved, Reason(code, f"the gate ended it: {safe.reason}")
            if safe.refusals and safe.state is GateState.RUN:
                refused = safe.refusals[0]
                return moved, Reason(refused.code, f"the gate refused: {refused}")
            pending = [command] if safe.state is GateState.HOLD else []
            moved = reading.joints.position - start
            self.largest = max(self.largest, float(np.abs(moved).max()))
            reason = self._stray(moved, servo, way, others, noise)
            if reason is not None:
                self.control.halt()
                return moved, reason
            place = safe.servos.tolist().index(servo.index) if servo.index in safe.servos else None
            there = place is not None and abs(safe.position[place] - target) < 1e-4
            rested = (now if rested is None else rested) if there else None
            if rested is not None and now - rested > 0.5 * SETTLE:
                tail.append(moved)
            if rested is not None and now - rested > SETTLE:
                return np.mean(tail, axis=0), None
        late = Reason(Code.NOT_ARRIVED, f"it did not arrive within {ARRIVE:.0f} s")
        return moved, None if tail else late

    def _stray(
        self, moved: Array, servo: Servo, way: float, others: NDArray[np.bool_], noise: float
    ) -> Reason | None:
        """Returns the reason to end a motion now, or None if the motion is right. Reasons are: another servo
        moves, the direction is wrong, or the motion is too large.
        """
        robot = self.driver.robot
        away = np.abs(moved) > max(STRAY, 3.0 * noise)
        if (away & others).any():
            index = int(np.argmax(np.where(others, np.abs(moved), 0.0)))
            how = "instead" if abs(moved[servo.index]) < abs(moved[index]) else "with it"
            words = f"{robot.servos[index].name} moved {how}, by {np.rad2deg(moved[index]):+.1f} degrees"
            return Reason(Code.MOVED_ANOTHER, words)
        own = moved[servo.index] * way
        if own < -max(STRAY, 3.0 * noise):
            return Reason(Code.MOVED_WRONG_WAY, f"it moved the wrong way, by {np.rad2deg(own):.1f} degrees")
        if own > 0.98 * MOST:
            return Reason(Code.MOVED_TOO_FAR, f"it moved too far, by {np.rad2deg(own):.1f} degrees")
        return None

    def _at_rest(self) -> tuple[Array, float]:
        """Returns the mean angles (n,) [rad] of the servos at rest, and three times the standard deviation
        [rad] of the noisiest encoder (at least 0.01 degrees)."""
        samples = [one.reading.joints.position for one in self.control.periods(duration=SETTLE)]
        noise = float(np.std(samples, axis=0).max()) * 3.0
        return np.mean(samples, axis=0), max(noise, float(np.deg2rad(0.01)))


def _verdict(
    robot: Robot, servo: Servo, moved: Array, reason: Reason | None, noise: float, seen: bool | None
) -> Finding:
    """Returns the finding about a servo after its motion.

    `moved` (n,) [rad] is the measured motion of all servos, positive in the commanded direction.
    """
    own = float(moved[servo.index])
    ratio = own / float(STEPS[-1])
    figures = {"commanded_deg": float(np.rad2deg(STEPS[-1])), "measured_deg": float(np.rad2deg(own))}
    if reason is not None:
        advice = ADVICE.get(reason.code, ELSE)
        return Finding(Level.FAULT, servo.name, reason.text, advice, figures)
    if abs(ratio * UNIT - 1.0) < 0.15 and own > 2.0 * noise:
        words = "it moved a 57th of the commanded motion"
        return Finding(Level.FAULT, servo.name, words, "radians are sent in place of degrees", figures)
    if not RATIO[0] <= ratio <= RATIO[1]:
        words = f"it moved {np.rad2deg(own):.2f} of {np.rad2deg(STEPS[-1]):.1f} degrees"
        advice = "check that it is stiff and free to move, and the unit of its commands"
        return Finding(Level.FAULT, servo.name, words, advice, figures)
    text = f"it moved {np.rad2deg(own):.2f} of {np.rad2deg(STEPS[-1]):.1f} degrees and back"
    if seen is None:
        return Finding(Level.NOTE, servo.name, f"{text}; the direction was not seen", figures=figures)
    if not seen:
        return Finding(
            Level.FAULT, servo.name, f"{text} by its encoder, but not in the expected direction",
            "another joint moved, or this one the other way: correct its sign, or its place in the part",
            figures,
        )  # fmt: skip
    return Finding(Level.OK, servo.name, text, figures=figures)
