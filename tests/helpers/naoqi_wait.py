"""The NAO of the tests of NAOqi, and waiting for it."""

from __future__ import annotations

import time
from collections.abc import Callable

from tci.drivers.driver import Driver
from tci.robot.catalogue import load_robot

ROBOT = load_robot("nao")
PATIENCE = 60.0
"""Time [s] to wait for results on a busy machine. On an idle machine they arrive immediately."""


def wait_for(what: Callable[[], bool], driver: Driver | None = None) -> None:
    """Waits until a condition is true, and reads `driver` meanwhile."""
    end = time.monotonic() + PATIENCE
    while not what():
        assert time.monotonic() < end, "it never came"
        if driver is not None:
            driver.read()
        time.sleep(0.005)
