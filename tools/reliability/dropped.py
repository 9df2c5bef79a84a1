"""Silences a process that commands a robot, and measures the time until the robot is at rest.

`python tools/reliability/dropped.py VIA` runs the robot's process, `... VIA swing` runs the commanding
process.
"""

from __future__ import annotations

import ctypes
import os
import queue
import random
import signal
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "tests")]

import tci
from tci.errors import DriverError, TciError
from tci.runtime.priority import real_time

SERVO, SPEED, STILL = "LElbowRoll", 0.3, 1e-6
PR_SET_PDEATHSIG = 1
ENDS = (-0.3, -1.4)
RATE = 250
"""Rate [Hz] of the robot's loop."""
STEADY = 25
"""Number of periods with motion after which the robot counts as moving."""
PAUSE = 0.01
"""If the time [s] between two of the robot's periods exceeds this value, the machine causes the delay. Such a
trial is repeated."""
SETTLED = 0.15
"""Time [s] without motion after which the robot counts as at rest. The reference may pause for less while
orders are in transit."""
LONGEST = 30.0
"""Longest time [s] to wait for a line of output from a process."""


def dropped(full: bool) -> Any:
    """Silences the commanding process over each driver with SIGSTOP, in one of four trials with SIGKILL, and
    measures the time until the robot rests."""
    from pool import gather
    from row import Row

    from helpers.wire_peers import PEERS

    names = [name for name, peer in PEERS.items() if peer.other_process]
    jobs = [(name, seed, 100 if full else 2) for seed in range(10 if full else 1) for name in names]
    done = gather("dropped", _drop, jobs, full=full)
    tried = {name: sum(len(one["times"]) for one in done if one["name"] == name) for name in names}
    slowest, worst = max(((max(one["times"], default=-1.0), one["name"]) for one in done), default=(-1.0, ""))
    failed, paused = (sum(one[key] for one in done) for key in ("failed", "paused"))
    words = f"{failed} trials in which the robot did not come to rest; otherwise at rest after at most "
    words += f"{slowest * 1e3:.0f} ms plus the driver's patience and the braking time (slowest: {worst})"
    if paused:
        words += f"; {paused} trials repeated, because the robot's process got no processor time for "
        words += f"{PAUSE * 1e3:.0f} ms"
    if away := [name for name in names if not tried[name]]:
        words += f"; drivers that did not run: {', '.join(sorted(away))}"
    return Row(
        f"SIGSTOP or SIGKILL to the commander of a moving robot, over each of {len(names)} drivers",
        min(tried.values()), 1000, "times with each driver", words,
        "at rest within 20 ms plus the driver's patience (80 ms; 100 ms over Unitree's) and the braking "
        "time",
        not failed and not away and slowest <= 0.02,
    )  # fmt: skip


def _drop(name: str, seed: int, count: int) -> dict[str, Any]:
    from helpers.wire_peers import PEERS

    with ExitStack() as stack:
        with suppress(TciError):  # real-time priority, if permitted, excludes the delays of other programs
            stack.enter_context(real_time())
        return _silences(PEERS[name](), name, seed, count)


def _silences(peer: Any, name: str, seed: int, count: int) -> dict[str, Any]:
    chance = random.Random(f"{name} {seed}")
    peer.script = Path(__file__)
    times: list[float] = []
    failed = paused = 0
    try:
        try:
            peer.start()
        except pytest.skip.Exception:  # the middleware of this driver is not installed
            return {"name": name, "times": [], "failed": 0, "paused": 0}
        robot = _Said(peer.process)
        with _Movers(peer.driver_via) as movers:
            mover = movers.start()
            while len(times) + failed < count:
                if not robot.moves():
                    raise DriverError(f"{name}: the robot never moves")
                time.sleep(chance.uniform(0.0, 0.02))  # a random moment between two messages
                kind = signal.SIGKILL if (len(times) + failed) % 4 == 1 else signal.SIGSTOP
                begin = time.monotonic()
                os.kill(mover, kind)
                rest, pause = robot.rests(begin)
                if pause > PAUSE:
                    paused += 1
                elif rest is None:
                    failed += 1
                elif (
                    rest >= begin
                ):  # otherwise the robot rested before the signal, since its commander got no processor time
                    times.append(round(rest - begin - peer.usual_silence - _braking(), 5))
                if kind is signal.SIGKILL:
                    mover = movers.start()
                else:
                    os.kill(mover, signal.SIGCONT)
    finally:
        peer.stop()
    return {"name": name, "times": times, "failed": failed, "paused": paused}


def _braking() -> float:
    """Returns the time [s] that a stop from the speed `SPEED` lasts within the servo's limits."""
    limits = next(servo.limits for servo in _nao().servos if servo.name == SERVO)
    assert limits.acceleration is not None
    assert limits.jerk is not None
    return SPEED / limits.acceleration + limits.acceleration / limits.jerk


class _Said:
    """Output lines of the robot's process. Each line contains a word, a time [s], and the longest pause [s]
    since the previous line."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._said: queue.Queue[tuple[str, float, float]] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, stamp, pause = line.split()
            self._said.put((word, float(stamp), float(pause)))

    def moves(self) -> bool:
        """Waits until the robot moves. Returns False if the robot does not move."""
        while not self._said.empty():
            self._said.get()
        with suppress(queue.Empty):
            while self._said.get(timeout=LONGEST)[0] != "moves":
                pass
            return True
        return False

    def rests(self, after: float) -> tuple[float | None, float]:
        """Returns the time [s] from which the robot stays at rest (None if it does not), and the longest
        pause [s] after the time `after` [s]."""
        rested, longest = None, 0.0
        with suppress(queue.Empty):
            while True:
                word, stamp, pause = self._said.get(timeout=LONGEST if rested is None else SETTLED)
                rested = stamp if word == "rests" else None
                longest = max(longest, pause if stamp >= after else 0.0)
        return rested, longest


class _Movers:
    """A process that has loaded and compiled everything that a commander needs. Each commander is a fork of
    this process."""

    def __init__(self, via: str) -> None:
        command = [sys.executable, __file__, via, "swing"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def start(self) -> int:
        """Starts a commander and returns its process ID."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        print(file=self._process.stdin, flush=True)
        self._last = int(self._process.stdout.readline())
        return self._last

    def __enter__(self) -> _Movers:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(ProcessLookupError):
            os.kill(self._last, signal.SIGKILL)
        self._process.communicate()


def _nao() -> tci.Robot:
    """The NAO of all drivers; over Unitree's topics it holds after the usual 0.1 s without data."""
    from helpers.patient import as_g1
    from helpers.wire_peers import Unitree

    return as_g1(tci.load_robot("nao"), Unitree.usual_silence)


def serve(via: str) -> None:
    """Serves a simulated NAO. Prints `goes` when the reference of its gate starts to move, `moves` after some
    periods of motion, and `rests` when the reference stops."""
    from tci.drivers.registry import open_server
    from tci.drivers.simulated import SimulatedDriver
    from tci.runtime.loop import Tick
    from tci.runtime.serve import serve

    state, since, before, pause = "", 0, 0.0, 0.0
    robot = _nao()
    servo = next(servo.index for servo in robot.servos if servo.name == SERVO)

    def tell(tick: Tick) -> None:
        nonlocal state, since, before, pause
        here = np.flatnonzero(tick.sent.servos == servo)
        speed = float(np.abs(tick.sent.velocity[here]).max(initial=0.0))
        new = "rests" if speed < STILL else "goes"
        since = since + 1 if new == state else 0
        now = time.monotonic()
        if not state:
            print("ready", flush=True)
        else:
            pause = max(pause, now - before)
        if state and (since == 0 or (since == STEADY and new == "goes")):
            print(new if since == 0 else "moves", now, pause, flush=True)
            pause = 0.0
        state, before = new, now

    with SimulatedDriver(robot, paced=True, rate=RATE) as driver, open_server(driver, via) as server:
        serve(server, observe=tell)


def movers(via: str) -> None:
    """For each line on stdin, forks a process that moves one joint back and forth until this process is
    killed."""
    warm_up(via)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    for _ in sys.stdin:
        if child := os.fork():
            print(child, flush=True)
        else:
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            swing(via)


def warm_up(via: str) -> None:
    """Imports and compiles everything that each fork would need. Opens no connection."""
    from tci.drivers.registry import load_driver

    load_driver(via.partition(":")[0])
    with tci.connect(_nao(), "sim") as driver:
        arm = driver.native("LArm")
        for now in driver.ticks(duration=0.01):
            driver.write(
                driver.gate.step([arm.command({SERVO: ENDS[0]}, speed=SPEED)], driver.read().joints, now)
            )


def swing(via: str) -> None:
    """Moves one joint back and forth without end."""
    with tci.connect(_nao(), via, arm=True) as driver:
        arm = driver.native("LArm")
        goal = 0
        for now in driver.ticks():
            joints = driver.read().joints
            if abs(arm.positions(joints)[SERVO] - ENDS[goal]) < 0.02:
                goal = 1 - goal
            driver.write(driver.gate.step([arm.command({SERVO: ENDS[goal]}, speed=SPEED)], joints, now))


if __name__ == "__main__":
    (movers if sys.argv[2:] == ["swing"] else serve)(sys.argv[1])
