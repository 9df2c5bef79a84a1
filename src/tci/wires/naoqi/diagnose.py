"""Compares a NAO's own data with the robot's description. Switches nothing and moves no joint."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from tci.drivers.diagnosis import Finding, Level
from tci.errors import DriverError
from tci.robot.description import Robot
from tci.wires.naoqi import autonomy, words
from tci.wires.naoqi.poller import Poller
from tci.wires.naoqi.session import answer, first_line
from tci.wires.naoqi.stream import Stream

CLOSE = np.deg2rad(0.6)
"""Largest difference [rad] between two limits that count as equal. Assumed: manufacturers round limits to
half a degree."""
OFFSET = 1.0
"""Largest offset [s] of the robot's clock with which the robot's logs can be compared with TCI's logs.
Assumed: a person compares the times of log entries with a resolution of one second."""


def examine(robot: Robot, poller: Poller, stream: Stream | None) -> tuple[Finding, ...]:
    """Returns the findings about the robot that `poller` reads. Raises DriverError if the robot is not
    connected."""
    if poller.trouble:
        raise DriverError(poller.trouble)
    found = [*_version(poller), *_trips(poller), *_clock(poller), *_skin(poller)]
    if stream is not None:
        found += [*_refused(stream), *_joints(poller), *_limits(robot, stream), *_motion(robot, poller)]
    return tuple(found)


def _version(poller: Poller) -> Iterator[Finding]:
    try:
        system = poller.services.session.service("ALSystem")
        version = answer(system.systemVersion(_async=True), "ALSystem.systemVersion", timeout=1.0)
    except (DriverError, RuntimeError, AttributeError) as error:
        yield Finding(Level.NOTE, "NAOqi", f"its version is not known: {first_line(error)}")
        return
    yield Finding(Level.OK, "NAOqi", f"version {version}", figures={"version": str(version)})


def _trips(poller: Poller) -> Iterator[Finding]:
    middle, late = np.quantile(poller.trips, [0.5, 0.99])
    figures = {"median_ms": 1e3 * float(middle), "p99_ms": 1e3 * float(late), **poller.counts}
    yield Finding(
        Level.OK, "questions", f"answered in {1e3 * middle:.1f} ms (median), {1e3 * late:.1f} ms (p99)",
        figures=figures,
    )  # fmt: skip
    lost = poller.counts["failures"]
    if lost or poller.counts["bad"]:
        yield Finding(
            Level.WARNING, "questions",
            f"{lost} without an answer, {poller.counts['reconnections']} new connections, "
            f"{poller.counts['bad']} damaged skin frames", "use a cable: NAO's radio links are slow",
        )  # fmt: skip


def _refused(stream: Stream) -> Iterator[Finding]:
    for words_, count in stream.errors.items():
        yield Finding(Level.WARNING, "commands", f"{count} refused by the robot: {words_}")


def _clock(poller: Poller) -> Iterator[Finding]:
    key = words.angle_key(poller.names[0], "Sensor")
    try:
        before = time.time()
        stamp = answer(poller.services.memory.getTimestamp(key, _async=True), "getTimestamp", timeout=1.0)
        now = 0.5 * (before + time.time())
        offset = float(stamp[1]) + 1e-6 * float(stamp[2]) - now
    except (DriverError, RuntimeError, AttributeError, TypeError, ValueError, IndexError):
        yield Finding(Level.NOTE, "clock", "the robot's time can't be read")
        return
    said, figures = f"the robot's clock is {offset:+.2f} s from this machine's", {"offset_s": offset}
    if abs(offset) > OFFSET:
        advice = "TCI does not need it; set the robot's clock (NTP) before you compare logs"
        yield Finding(Level.NOTE, "clock", said, advice, figures)
    else:
        yield Finding(Level.OK, "clock", said, figures=figures)


def _joints(poller: Poller) -> Iterator[Finding]:
    motion = poller.services.motion
    known = answer(motion.getBodyNames("Body", _async=True), "ALMotion.getBodyNames", timeout=1.0)
    more = [name for name in known if name not in poller.names]
    if more:
        yield Finding(
            Level.NOTE, "joints", f"the robot has joints that the description lacks: {', '.join(more)}",
            "TCI neither reads nor moves them",
        )  # fmt: skip


def _limits(robot: Robot, stream: Stream) -> Iterator[Finding]:
    for servo in robot.servos:
        limits, place = servo.limits, servo.index
        if limits.lower is None or limits.upper is None:
            continue
        ours = np.array([limits.lower, limits.upper])
        theirs = np.array([stream.lower[place], stream.upper[place]])
        if np.abs(ours - theirs).max() > CLOSE:
            (a, b), (c, d) = np.rad2deg(ours), np.rad2deg(theirs)
            advice = "no action needed: the narrower limits apply"
            wider = ours[0] < theirs[0] - CLOSE or ours[1] > theirs[1] + CLOSE
            if wider:
                advice = "the robot does not follow beyond its own limits: correct the description"
            yield Finding(
                Level.WARNING if wider else Level.NOTE, servo.name,
                f"limits {a:.1f} .. {b:.1f} degrees in the description, {c:.1f} .. {d:.1f} in the robot",
                advice,
                {"lower_deg": float(c), "upper_deg": float(d)},
            )  # fmt: skip
        if limits.velocity is not None and limits.velocity > 1.05 * stream.fastest[place]:
            fast, top = np.rad2deg([limits.velocity, stream.fastest[place]])
            yield Finding(
                Level.WARNING, servo.name,
                f"{fast:.0f} degrees/s in the description, at most {top:.0f} in the robot",
                "the servo would lag behind: correct the description", {"velocity_deg_s": float(top)},
            )  # fmt: skip


def _motion(robot: Robot, poller: Poller) -> Iterator[Finding]:
    session, motion = poller.services.session, poller.services.motion
    chains = list(dict.fromkeys(servo.robot_part for servo in robot.servos))
    found = autonomy.movers(session, motion, chains)
    for mover in found:
        yield Finding(
            Level.WARNING, "autonomy", f"{mover.name} moves the joints by itself",
            "an armed driver refuses that: end it, or connect with ?life=off behind the address",
        )  # fmt: skip
    if not found:
        yield Finding(Level.OK, "autonomy", "nothing moves the joints by itself")
    for words_ in autonomy.reflexes(motion):
        yield Finding(Level.NOTE, "autonomy", f"on: {words_}", "it may change what you command")


def _skin(poller: Poller) -> Iterator[Finding]:
    sensed = {frame.patch for frame in poller.latest.reading.skin}
    missing: list[Any] = [
        f"{' '.join(keys)} ({patch})" for patch, keys in poller.keys.items() if patch not in sensed
    ]
    if missing:
        yield Finding(
            Level.WARNING, "skin", f"nothing in ALMemory under {', '.join(missing)}",
            "publish each patch as one vector of numbers there, say another key in the description's binding "
            "(<address of=PATCH to=KEY/>), or read the skin another way: --via 'naoqi://HOST + LINK'",
        )  # fmt: skip
