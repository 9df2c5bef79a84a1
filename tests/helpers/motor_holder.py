"""Program that controls the motors of a robot until it is killed: `python motor_holder.py DOMAIN PERIOD`.
Prints `asked` after it has requested the motors, and `holding` when the robot follows its targets.

`python motor_holder.py -` reads lines `DOMAIN PERIOD` from its input, and starts a copy of itself for each
line. Each copy prints its domain, its process ID and a word: `begun`, then the words above, or `failed` if
the request is refused.
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable

import numpy as np

from tci.errors import DriverError
from tci.shared.interface_node import InterfaceNode
from tci.wires.unitree.address import parse_unitree
from tci.wires.unitree.handover import holding
from tci.wires.unitree.health import Health
from tci.wires.unitree.held_motors import HeldMotors
from tci.wires.unitree.motors import ARM_GAINS, MOTORS


def held_motors(place: str, period: float) -> HeldMotors:
    """Returns an object that has requested the motors."""
    where = parse_unitree(place)
    held = HeldMotors(where, period, InterfaceNode(where.interface, where.domain), Health())
    held.take()
    return held


def hold(domain: int, period: float, tell: Callable[[str], None]) -> None:
    """Controls the motors, and prints its progress."""
    held = held_motors(f"lo/{domain}", period)
    tell("asked")
    held.wait()
    targets = holding(np.full(MOTORS, 0.3), ARM_GAINS)
    targets["dq"] = targets["tau"] = 0.1
    for count in range(100_000):
        held.follow(np.ones(MOTORS, dtype=bool), targets)
        held.poll()
        time.sleep(period)
        if count == 5:
            tell("holding")


def copies() -> None:
    """For each input line, controls the robot's motors in a copy (fork) of this process, which has imported
    all modules."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the parent never waits for its child processes
    for line in sys.stdin:
        domain, period = line.split()
        if process := os.fork():
            print(domain, process, "begun", flush=True)
        else:
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)

            def tell(word: str, domain: str = domain) -> None:
                print(domain, os.getpid(), word, flush=True)

            try:
                hold(int(domain), float(period), tell)
            except DriverError:
                tell("failed")
            os._exit(0)


def main() -> None:
    if sys.argv[1] == "-":
        copies()
    else:
        hold(int(sys.argv[1]), float(sys.argv[2]), lambda word: print(word, flush=True))


if __name__ == "__main__":
    main()
