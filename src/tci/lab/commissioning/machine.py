"""Examines this machine: software versions, installed drivers and robots, and the accuracy of the machine's
clock."""

from __future__ import annotations

import os
import platform
import sys
from collections.abc import Iterator

import numpy as np

import tci
from tci.drivers.diagnosis import Finding, Level
from tci.drivers.lease import FOLDER, lease
from tci.drivers.registry import driver_names, load_driver
from tci.errors import MissingExtraError, TciError
from tci.messages.clock import MonotonicClock, ticks
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot, robot_names
from tci.support.installed import clashes, installed_by

PERIOD = 0.002
"""Period [s] of the wake-ups in the test of the clock, equal to the control period of simulated robots."""
LATE = 1e-3
"""Largest delay [s] of wake-ups (99th percentile) that gives no warning. Assumed: a loop with a period of 2
ms can tolerate half a period."""


def examine_machine(*, duration: float = 0.4) -> tuple[Finding, ...]:
    """Returns findings about this machine. The clock is tested for the time `duration` [s]."""
    system = f"TCI {tci.__version__}, Python {platform.python_version()}, {platform.platform(terse=True)}"
    return (
        Finding(Level.OK, "machine", f"{system}, {os.cpu_count()} processors"),
        *_shared_folders(),
        *_drivers(),
        *_robots(),
        *_lease(),
        *_timing(duration),
    )


def _shared_folders() -> Iterator[Finding]:
    for clash in clashes():
        yield Finding(Level.WARNING, f"package {clash.module}", clash.said, clash.advice)


def _drivers() -> Iterator[Finding]:
    for name in driver_names():
        yield _driver(name)


def _driver(name: str) -> Finding:
    subject = f"driver {name}"
    try:
        load_driver(name).load_library()
    except MissingExtraError as error:
        return Finding(Level.NOTE, subject, f"not installed: it needs {error.missing}", error.advice)
    except Exception as error:
        words = f"its module fails: {type(error).__name__}: {error}"
        return Finding(Level.FAULT, subject, words, "install its package again")
    return Finding(Level.OK, subject, f"ready; {_library(name)}")


def _library(driver: str) -> str:
    """Returns as text the name and version of the library that a driver needs and an extra of TCI installs,
    or that no extra is needed."""
    found = ", ".join(f"{name} {release}" for name, release in installed_by(driver).items())
    return f"its library: {found}" if found else "it needs no extra"


def _robots() -> Iterator[Finding]:
    for name in robot_names():
        try:
            robot = load_robot(name)
        except TciError as error:
            yield Finding(Level.NOTE, f"robot {name}", str(error))
            continue
        drivers = ", ".join(binding.middleware for binding in robot.all_bindings)
        yield Finding(Level.OK, f"robot {name}", f"{robot.title}; drivers: {drivers}")


def _lease() -> Iterator[Finding]:
    try:
        with lease(f"doctor:{os.getpid()}"):
            pass
    except (TciError, OSError) as error:
        yield Finding(
            Level.FAULT,
            "lease",
            f"no program could command a robot: {error}",
            f"set {FOLDER} to a folder of your own, in every program that commands the robot",
        )


def _delays(times: Array) -> Array:
    """Returns the delay (n,) [s] of each tick of a loop. `times` (n,) [s] are the times of the ticks,
    measured from the time at which the first was due.

    A tick is due at the first multiple of the loop's period after the previous tick. The delay of an early
    tick is 0.
    """
    due = np.append(0.0, np.floor(times[:-1] / PERIOD + 0.001) + 1.0) * PERIOD
    return np.maximum(times - due, 0.0)


def _timing(duration: float) -> Iterator[Finding]:
    clock = MonotonicClock()
    begin = clock.now()
    late = _delays(np.array([now - begin for now in ticks(clock, PERIOD, duration=duration)]))
    middle, worst = np.quantile(late, [0.5, 0.99])
    text = (
        f"wakes up {1e6 * middle:.0f} us late (median), {1e3 * worst:.2f} ms (p99; "
        f"allowed: {1e3 * LATE:g} ms)"
    )
    figures = {"late_p50_us": 1e6 * float(middle), "late_p99_us": 1e6 * float(worst)}
    if worst > LATE:
        yield Finding(
            Level.WARNING,
            "clock",
            text,
            "loops will miss periods: close other programs, or run on a machine that is less busy",
            figures,
        )
    else:
        yield Finding(Level.OK, "clock", text, figures=figures)
    if sys.platform != "linux":
        yield Finding(Level.NOTE, "clock", "not Linux: timers are coarser here")
