"""Examines the data of a driver and lists faults, each with advice. Commands no motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.contact.trust import SETTLES, SHOWS
from tci.lab.commissioning.assumptions import powers, too_quick
from tci.lab.commissioning.friction import feeling_servos
from tci.lab.commissioning.streams import Observation, Stream
from tci.messages import Reading
from tci.robot.description import Patch, Robot, Sensor
from tci.robot.kinematics import KinematicChain

SLOW = 0.8
"""Fraction of the nominal frame rate below which a stream of frames counts as slow. Assumed: the rates of
healthy streams vary by a few percent."""
OFF = 0.15
"""Largest permitted difference between the median of the values in a patch's latest frame and the patch's
rest value, as a fraction of the sensor's range. A larger difference gives a warning. Assumed: larger than the
drift of a sensor, and smaller than the difference that an inverted or drift-compensated sensor causes."""
OFTEN = 0.1
"""Share of the time after gaps between readings from which on they are a warning."""
TURN = 2.0 * np.pi
"""Largest plausible joint angle [rad]. No joint of a humanoid turns by more than a full turn."""


def judge(driver: Driver, seen: Observation) -> tuple[Finding, ...]:
    """Returns the faults in the data that `observe` measured, and the findings of `Driver.diagnose`.

    Raises DriverError if the robot does not respond.
    """
    return (
        *driver.diagnose(),
        *(Finding(Level.NOTE, name, "left out by the address") for name in driver.info.left_out),
        *_joint_stream(driver, seen.streams[0], seen.cost),
        *_joint_values(driver, seen),
        *(found for reading in seen.readings[-1:] for found in judge_torques(driver.robot, reading)),
        *(found for stream in seen.streams[1:] for found in _skin_stream(driver.robot, stream)),
        *_skin_values(driver.robot, seen),
        *_contact(driver, seen),
        *_limits(driver.robot),
    )


def _limits(robot: Robot) -> Iterator[Finding]:
    for sentence in too_quick(robot):
        what, _, advice = sentence.partition("; valid: ")
        yield Finding(Level.NOTE, "limits", what, f"in the description: {advice}")
    for sentence in powers(robot):
        yield Finding(Level.OK, "limits", sentence)


def _joint_stream(driver: Driver, stream: Stream, cost: Sequence[float] | np.ndarray) -> Iterator[Finding]:
    stale = driver.gate.stale_after
    figures = {"rate_hz": stream.rate, "age_ms": 1e3 * stream.age, "oldest_ms": 1e3 * stream.oldest}
    text = (
        f"{stream.rate:.0f} readings/s, {1e3 * stream.age:.1f} ms old when read, "
        f"at most {1e3 * stream.oldest:.1f} ms"
    )
    if not stream.frames:
        yield Finding(
            Level.FAULT, "joints", "no joint data at all", "check the robot with its own tools first"
        )
    elif stream.age > stale or stream.age < -stale:
        yield Finding(
            Level.FAULT,
            "joints",
            f"{text}; the gate holds at {1e3 * stale:.0f} ms",
            "look for a slow network or a wrong clock; a robot that is only slow needs a larger "
            "stale_after in its description",
            figures,
        )
    elif stream.oldest > stale:
        yield Finding(
            Level.WARNING,
            "joints",
            f"{text}; the gate holds at {1e3 * stale:.0f} ms",
            "the robot would hold now and then: use a cable, not a radio link, or close other programs",
            figures,
        )
    else:
        yield Finding(Level.OK, "joints", text, figures=figures)
    if stream.older:
        yield Finding(Level.WARNING, "joints", f"{stream.older} readings arrived after newer ones")
    late = float(np.quantile(cost, 0.99)) if len(cost) else 0.0
    if late > driver.period:
        yield Finding(
            Level.WARNING,
            "joints",
            f"reading takes {1e3 * late:.1f} ms (p99), a period has {1e3 * driver.period:.1f} ms",
            "the loop will miss periods: lower the binding's rate in the description",
            {"read_p99_ms": 1e3 * late, "period_ms": 1e3 * driver.period},
        )


def _joint_values(driver: Driver, seen: Observation) -> Iterator[Finding]:
    if not seen.readings:
        return
    robot, unreached = driver.robot, driver.info.unreached
    joints = seen.readings[-1].joints
    if joints.position.shape != (len(robot.servos),):
        yield Finding(
            Level.FAULT,
            "joints",
            f"{joints.position.size} angles; the description has {len(robot.servos)} servos",
            "connect to the described robot, or use the description of this one",
        )
        return
    for servo, angle in zip(robot.servos, joints.position.tolist(), strict=True):
        lower, upper = servo.limits.lower, servo.limits.upper
        if not np.isfinite(angle):
            yield Finding(Level.FAULT, servo.name, f"its angle is {angle}", "check the servo and its cable")
        elif abs(angle) > TURN:
            yield Finding(
                Level.FAULT,
                servo.name,
                f"its angle is {angle:.1f} rad, more than a turn",
                "the robot may send degrees: check the unit in its binding",
                {"angle_rad": angle},
            )
        elif lower is not None and upper is not None and not lower <= angle <= upper:
            yield Finding(
                Level.WARNING,
                servo.name,
                f"it is at {np.rad2deg(angle):.1f} degrees, outside its limits "
                f"{np.rad2deg(lower):.1f} .. {np.rad2deg(upper):.1f}",
                "only inward motion is allowed there; if the robot can be there, correct the limits "
                "in the description, or its zero (tci check --hardware)",
                {"angle_deg": float(np.rad2deg(angle))},
            )
    powered = joints.powered
    if powered is not None and (
        off := [s.name for s in robot.servos if not powered[s.index] and s.index not in unreached]
    ):
        yield Finding(
            Level.NOTE,
            "joints",
            f"{len(off)} of {len(robot.servos)} servos are off: {_some(off)}",
            "switch them on before you command them",
        )
    if joints.modes is not None:
        wrong = [
            f"{servo.name} ({mode.value})"
            for servo, mode in zip(robot.servos, joints.modes, strict=True)
            if mode is not None and mode not in servo.modes
        ]
        if wrong:
            yield Finding(
                Level.WARNING,
                "joints",
                f"in a mode that the description does not have: {_some(wrong)}",
                "correct the description's modes, or the robot's configuration",
            )


def _skin_stream(robot: Robot, stream: Stream) -> Iterator[Finding]:
    expected = stream.expected or 0.0
    figures = {"rate_hz": stream.rate, "expected_hz": expected, "lost": float(stream.lost)}
    text = f"{stream.rate:.0f} frames/s of {expected:.0f}, {1e3 * stream.age:.1f} ms old when read"
    if not stream.frames:
        yield Finding(
            Level.FAULT,
            stream.name,
            "no frame at all",
            "switch the skin on, and publish it under the name in the description's binding",
        )
        return
    if stream.frames == 1 or stream.rate == 0.0:
        yield Finding(
            Level.FAULT,
            stream.name,
            f"one frame, {stream.oldest:.1f} s old, and no new one",
            "the source of the skin stands still: restart it",
        )
        return
    if stream.rate < SLOW * expected:
        yield Finding(
            Level.WARNING,
            stream.name,
            text,
            "a reflex answers that much later: check the skin's driver, or correct the patch's rate",
            figures,
        )
    else:
        yield Finding(Level.OK, stream.name, text, figures=figures)
    if stream.lost or stream.older:
        yield Finding(
            Level.WARNING,
            stream.name,
            f"{stream.lost} of {stream.sent} frames lost, {stream.older} arrived after newer ones",
            "improve the connection: another carrier, a cable, less traffic",
            figures,
        )


def judge_torques(robot: Robot, reading: Reading) -> Iterator[Finding]:
    """Yields a finding if the robot detects touches by joint torques, but the joints report no torques."""
    feeling = feeling_servos(robot, KinematicChain(robot)) if len(robot.skin) < len(robot.patches) else []
    torque = reading.joints.torque
    silent = [one.name for one in feeling if torque is None or not np.isfinite(torque[one.index])]
    if silent:
        advice = (
            "make its driver report them (one that reads currents: docs/touch-without-skin.md), or leave out "
            "the patches that are felt through joints"
        )
        level = Level.FAULT if len(silent) == len(feeling) else Level.WARNING
        yield Finding(level, "joints", f"no torques, which feeling touches needs: {_some(silent)}", advice)


def _skin_values(robot: Robot, seen: Observation) -> Iterator[Finding]:
    frames = {frame.patch: frame for reading in seen.readings for frame in reading.skin if not frame.empty}
    for patch in robot.patches:
        if patch.name not in frames:
            continue
        values = np.asarray(frames[patch.name].values)
        if values.shape != (patch.channels,):
            yield Finding(
                Level.FAULT,
                patch.name,
                f"frames of {values.size} values; the description has {patch.channels}",
                "another skin, or another description: correct its channels",
            )
        elif values.dtype.kind not in "uif":
            yield Finding(Level.FAULT, patch.name, f"frames of type {values.dtype}; valid: numbers")
        else:
            yield from _raw(patch, values.astype(float))


def _raw(patch: Patch, values: np.ndarray) -> Iterator[Finding]:
    sensor = patch.sensor
    finite = np.isfinite(values)
    valid = finite & (values >= sensor.lowest) & (values <= sensor.highest)
    if not valid.all():
        yield Finding(
            Level.WARNING if valid.any() else Level.FAULT,
            patch.name,
            f"{int((~valid).sum())} of {values.size} values are outside the range of its sensor "
            f"({sensor.lowest:g} .. {sensor.highest:g})",
            "they are ignored: correct the sensor's min and max in the description, or its unit",
        )
    if valid.any():
        yield from _rest(patch, sensor, values[valid])


def _rest(patch: Patch, sensor: Sensor, values: np.ndarray) -> Iterator[Finding]:
    middle = float(np.median(values))
    off = abs(middle - sensor.rest) / (sensor.highest - sensor.lowest)
    figures = {"median": middle, "rest": sensor.rest}
    if off > OFF:
        yield Finding(
            Level.WARNING,
            patch.name,
            f"its values are around {middle:g}, at rest they should be {sensor.rest:g}",
            "remove what lies on it; otherwise it is compensated, inverted or another sensor: correct "
            "rest and pascal_per_count in the description",
            figures,
        )
    dead = int((values == 0.0).sum()) if sensor.rest != 0.0 else 0
    if dead:
        yield Finding(
            Level.NOTE,
            patch.name,
            f"{dead} of {values.size} channels are 0",
            "channels without a taxel read 0; a taxel among them is masked as dead",
            {"zeros": float(dead)},
        )


def _contact(driver: Driver, seen: Observation) -> Iterator[Finding]:
    """What parts do that meet somebody, and what tells of those whom a link without skin meets."""
    settings = driver.gate.settings.contact
    if not seen.readings:
        return
    if settings is None:
        yield Finding(Level.OK, "contact", "the process that serves the robot notices whom it meets")
        return
    if settings.softens and OwnWeight(driver.robot).known:
        yield Finding(Level.OK, "way back", "arms go back softly from whom they meet, a waist stiffly")
    else:
        why = "this connection changes no stiffness" if not settings.softens else "the model has no masses"
        yield Finding(Level.OK, "way back", f"parts go back from whom they meet, but stiffly: {why}")
    held = f"a joint is {np.rad2deg(settings.held):.0f} degrees behind its reference"
    torque, out = seen.readings[-1].joints.torque, driver.info.unreached
    servos = [one for one in driver.robot.servos if one.index not in out]
    silent = [one.name for one in servos if torque is None or not np.isfinite(torque[one.index])]
    gaps, lasted = seen.streams[0].gaps, seen.readings[-1].joints.stamp - seen.readings[0].joints.stamp
    if len(silent) == len(servos):
        yield Finding(
            Level.NOTE, "contact", f"no joint torques: a link without skin notices whom it meets once {held}",
            "see docs/reliability.md; currents that are no torques yet: docs/touch-without-skin.md",
        )  # fmt: skip
        return
    if silent:
        yield Finding(Level.NOTE, "contact", f"no torques of {_some(silent)}: they notice it once {held}")
    if settings.stands:
        yield Finding(Level.OK, "contact", "joint torques tell whom a link without skin meets")
    elif gaps * SETTLES > OFTEN * lasted:
        yield Finding(
            Level.WARNING, "contact",
            f"{gaps} gaps between readings in {lasted:.1f} s: for {SETTLES:g} s after each, joint torques "
            f"tell of nobody, and a link without skin notices whom it meets once {held}",
            "use a cable, not a radio link, or close other programs", {"gaps": float(gaps)},
        )  # fmt: skip
    else:
        yield Finding(
            Level.OK, "contact",
            f"joint torques tell whom a link without skin meets, after joints have moved for {SHOWS:g} s as "
            f"expected; until then once {held}", figures={"gaps": float(gaps)},
        )  # fmt: skip


def _some(names: Sequence[str], most: int = 6) -> str:
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
