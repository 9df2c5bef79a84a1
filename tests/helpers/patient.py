"""Program that serves a simulated robot as `tci serve` does, for tests: `python patient.py VIA [SILENCE]`.

By default the timeouts are longer than those of the description, so that a busy machine causes no fault. The
program prints `ready`, then a line for each change of the gate's state, with the time [s] and the reason.
"""

from __future__ import annotations

import sys
import time

import tci
from tci.drivers.registry import open_server
from tci.drivers.simulated import SimulatedDriver
from tci.robot.description import Robot
from tci.robot.description.binding import Address, Binding
from tci.runtime.loop import Tick
from tci.runtime.priority import real_time_where_permitted
from tci.runtime.serve import serve

PATIENCE = 0.5
"""Time [s] without data after which connections count as lost in these tests."""
RATE = 200.0
"""Periods per second, as on most robots. At the 500 of a simulation, two of them take a slow machine's two
processors, and everybody else waits."""
MOTORS = {"Head": 12, "LArm": 15, "RArm": 22}
"""For each part of a NAO: number of the first G1 motor that replaces the part's first joint in these tests.
The other joints use the following motors."""
HANDS = {"LHand": "left:index", "RHand": "right:index"}
"""The NAO's hands are joints of Inspire hands, so that these are held to all that drivers are."""


def as_g1(robot: Robot, silence: float) -> Robot:
    """A NAO that is mapped to the motors of a G1 too; over their topics it holds after `silence` [s] without
    data."""
    addresses = tuple(
        Address(of=servo.name, to=HANDS.get(servo.name, str(first + place)))
        for part, first in MOTORS.items()
        for place, servo in enumerate(robot.servos_of(part))
    )
    own = Binding(middleware="unitree", rate=100, stale_after=silence, addresses=addresses)
    return robot.model_copy(update={"bindings": (*robot.bindings, own)})


def patient(name: str, silence: float = PATIENCE) -> Robot:
    """A robot by name that waits for `silence` [s] without data before it holds. A NAO is mapped to the
    motors of a G1 too."""
    robot = tci.load_robot(name)
    return (as_g1(robot, silence) if name == "nao" else robot).with_stale_after(silence)


def main() -> None:
    state: list[str] = []

    def tell(tick: Tick) -> None:
        if not state:
            print("ready", flush=True)
        if not state or state[0] != tick.sent.state.value:
            state[:] = [tick.sent.state.value]
            print(tick.sent.state.value, time.monotonic(), tick.sent.reason or "", flush=True)

    robot = patient("nao", *map(float, sys.argv[2:]))
    with (
        SimulatedDriver(robot, paced=True, rate=RATE) as driver,
        open_server(driver, sys.argv[1]) as server,
        # real time as on a robot, where the loop does not wait for other programs
        real_time_where_permitted(),
    ):
        serve(server, observe=tell)


if __name__ == "__main__":
    main()
