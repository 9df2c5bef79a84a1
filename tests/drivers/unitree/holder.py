"""Program that holds the motors of a robot until it is killed: `python holder.py DOMAIN PERIOD`. It prints
`asked` once it has asked for them, and `holding` once its targets are followed."""

from __future__ import annotations

import sys
import time

import numpy as np

from tci.drivers.unitree.address import parse_unitree
from tci.drivers.unitree.handover import KP, ROWS, Q
from tci.drivers.unitree.health import Health
from tci.drivers.unitree.held_motors import HeldMotors
from tci.drivers.unitree.motors import ARM_GAINS, MOTORS
from tci.drivers.unitree.node import UnitreeNode


def held_motors(place: str, period: float) -> HeldMotors:
    """Returns motors that are asked for."""
    where = parse_unitree(place)
    held = HeldMotors(where, period, UnitreeNode(where.interface, where.domain), Health())
    held.take()
    return held


def main() -> None:
    period = float(sys.argv[2])
    held = held_motors(f"lo/{sys.argv[1]}", period)
    print("asked", flush=True)
    held.wait()
    targets = np.full((ROWS, MOTORS), 0.1)
    targets[Q], targets[KP:] = 0.3, ARM_GAINS
    for count in range(100_000):
        held.follow(np.ones(MOTORS, dtype=bool), targets)
        held.poll()
        time.sleep(period)
        if count == 5:
            print("holding", flush=True)


if __name__ == "__main__":
    main()
