"""First check of a robot: reads the sensors, compares the posture with the encoders, moves each servo by 2
degrees, and asks the operator to press the skin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.errors import UnknownNameError
from tci.lab.commissioning.doctor import judge
from tci.lab.commissioning.hardware import ServoCheck
from tci.lab.commissioning.hardware_skin import SkinCheck
from tci.lab.commissioning.operator import Operator
from tci.lab.commissioning.streams import observe
from tci.messages import Mode, PlatformCommand
from tci.robot.description import Patch, Robot, Servo
from tci.robot.joint_map import generic_posture
from tci.runtime.control import Control
from tci.runtime.watchdogs import missed_periods

LOOK = 1.0
"""Time [s] for which the check reads the robot's sensors before the first motion. Assumed: every patch sends
at least ten frames in this time."""
STIFFNESS = 0.8
"""Stiffness of the servos that this check switches on, as a fraction of full stiffness. Assumed: enough for
small motions, and low enough that a person can stop the joint by hand."""
POWER = 2.0
"""Longest time [s] to wait until the servos report that their power is on. Assumed: a servo reports its state
several times per second."""


def first_minutes(
    driver: Driver,
    operator: Operator,
    *,
    servos: Sequence[Servo],
    patches: Sequence[Patch],
    taxels: int | None = 12,
    show: Callable[[Finding], None] = lambda finding: None,
) -> tuple[tuple[Finding, ...], float]:
    """Checks the servos `servos`, then the patches `patches`. `taxels` is the number of taxels that are
    checked on each patch; None checks all taxels. Each motion needs the operator's permission. Calls `show`
    immediately with each finding. Does not move a robot part if the sensor data showed a fault or warning for
    a servo of this part, or if the operator answers that the part's posture is wrong. Moves no part after a
    fault of the whole robot. Returns all findings, and the largest motion [rad] that was measured.

    Raises DriverError if another program commands the robot, or if the connection fails. Also raises the
    errors of `operator`.
    """
    found: list[Finding] = []

    def note(findings: Iterator[Finding]) -> None:
        for finding in findings:
            found.append(finding)
            show(finding)

    control = Control(driver, who="the first check", watchdogs=[missed_periods])
    check = ServoCheck(control, operator)
    with control:
        note(finding for finding in judge(driver, observe(driver, LOOK)) if finding.level is not Level.OK)
        names = {servo.name for servo in driver.robot.servos}
        if any(finding.level is Level.FAULT and finding.subject not in names for finding in found):
            note(iter([Finding(Level.NOTE, "motion", "nothing was moved", "mend the faults above first")]))
            return tuple(found), 0.0
        bad = {finding.subject for finding in found if finding.level in (Level.WARNING, Level.FAULT)}
        # A wrong unit or joint order affects all servos of a robot part.
        parts = {servo.robot_part for servo in driver.robot.servos if servo.name in bad}
        wrong = {servo.name for servo in driver.robot.servos if servo.robot_part in parts}
        note(_postures(driver, operator, servos))
        unsure = {finding.subject for finding in found if finding.level is Level.FAULT}
        for part in driver.robot.parts:
            if part.name in unsure:
                wrong |= set(_servos_of(driver.robot, part.name))
        note(_stiffen(control, operator, [servo for servo in servos if servo.name not in wrong]))
        for servo in servos:
            note(iter([_left_out(servo) if servo.name in wrong else check.check(servo)]))
        if patches:
            touch = SkinCheck(driver, operator)
            for patch in patches:
                note(touch.check(patch, taxels))
    return tuple(found), check.largest


def wanted(robot: Robot, names: Sequence[str]) -> tuple[list[Servo], list[Patch]]:
    """Returns the servos and the patches for a list of names. A name is the name of a servo, of a patch, of a
    robot part or of a generic part. For an empty list, returns all servos and patches. Raises
    UnknownNameError for an unknown name.
    """
    if not names:
        return list(robot.servos), list(robot.skin)
    servos: list[Servo] = []
    patches: list[Patch] = []
    generic = {part.name for part in robot.parts}
    for name in names:
        mine = _servos_of(robot, name) if name in generic else []
        some = [
            servo for servo in robot.servos if name in (servo.name, servo.robot_part) or servo.name in mine
        ]
        skin = [patch for patch in robot.skin if name in (patch.name, patch.part)]
        if not some and not skin:
            moved = [part.name for part in robot.parts if _servos_of(robot, part.name)]
            felt = [name for patch in robot.skin for name in (patch.part, patch.name)]
            own = [name for servo in robot.servos for name in (servo.robot_part, servo.name)]
            raise UnknownNameError("servo, part or patch", name, dict.fromkeys([*moved, *felt, *own]))
        servos += [servo for servo in some if servo not in servos]
        patches += [patch for patch in skin if patch not in patches]
    return servos, patches


def _servos_of(robot: Robot, part: str) -> list[str]:
    return [robot.servos[moved].name for joint in robot.part(part).servos for moved in joint.moved]


def _left_out(servo: Servo) -> Finding:
    return Finding(Level.FAULT, servo.name, "not moved: see above", "correct that first, then check it again")


def _postures(driver: Driver, operator: Operator, servos: Sequence[Servo]) -> Iterator[Finding]:
    """Asks the operator if the robot's posture agrees with the encoders' angles. The answers check zeros,
    signs and units."""
    names = {servo.name for servo in servos}
    posture = generic_posture(driver.robot, driver.read().joints)
    for part in driver.robot.parts:
        if not names & set(_servos_of(driver.robot, part.name)):
            continue
        angles = ", ".join(
            f"{servo.name} {np.rad2deg(angle):.0f}"
            for servo, angle in zip(part.servos, posture[part.name], strict=True)
            if servo.servo is not None
        )
        question = f"{part.name} is at (degrees): {angles}. Does it look so, within 10 degrees?"
        right = operator.saw(question, None)
        if right is None:
            yield Finding(Level.NOTE, part.name, "its posture was not checked")
        elif right:
            yield Finding(Level.OK, part.name, f"its posture agrees with its encoders: {angles}")
        else:
            yield Finding(
                Level.FAULT, part.name, f"its posture does not agree with its encoders: {angles}",
                "correct zero (transform_displacement), sign (transform_factor) or unit in the description, "
                "or calibrate the robot; nothing of this part is moved",
            )  # fmt: skip


def _stiffen(control: Control, operator: Operator, servos: Sequence[Servo]) -> Iterator[Finding]:
    """Switches on the servos that are off, if the operator gives permission."""
    driver = control.driver
    powered, unreached = driver.read().joints.powered, driver.info.unreached
    servos = [servo for servo in servos if servo.index not in unreached]
    off = [] if powered is None else [servo for servo in servos if not powered[servo.index]]
    if not off:
        return
    names = ", ".join(servo.name for servo in off)
    if not operator.may(f"switch on {names}"):
        yield Finding(Level.NOTE, "power", f"off: {names}")
        return
    count = len(off)
    share = PlatformCommand(
        Mode.STIFFNESS, np.array([s.index for s in off]), np.full(count, STIFFNESS), np.full(count, np.inf)
    )
    pending = [share]
    for moment in control.periods(duration=POWER):
        control.act(pending)
        pending, joints = [], moment.reading.joints
        if joints.powered is not None and all(joints.powered[servo.index] for servo in off):
            yield Finding(Level.OK, "power", f"switched on: {names}")
            return
    yield Finding(Level.FAULT, "power", f"still off: {names}", "switch them on with the robot's own tools")
