"""Somebody who moves a robot from another process falls silent: how long until the robot is at rest.

`python tools/reliability/dropped.py VIA` is the robot's process, `... VIA swing` the one that moves it.
"""

from __future__ import annotations

import queue
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2] / "tests")]

import tci
from tci.errors import LinkError

SERVO, SPEED, STILL = "LElbowRoll", 0.3, 1e-6
ENDS = (-0.3, -1.4)
LONGEST = 60.0
"""Time [s] that a process may take to say what it is waited for."""


def dropped(full: bool) -> Any:
    """SIGSTOP and SIGKILL in turn, of what commands over each link; until its reference rests."""
    from pool import gather
    from row import Row

    from middleware.links import PEERS

    names = [name for name, peer in PEERS.items() if peer.other_process]
    jobs = [(name, seed, 20 if full else 2) for seed in range(50 if full else 1) for name in names]
    done = gather("dropped", _drop, jobs, full=full, alone=True)
    ran = [name for name in names if any(one["tried"] for one in done if one["name"] == name)]
    slowest, worst = max(((one["slowest"], one["name"]) for one in done), default=(0.0, ""))
    failed = sum(one["failed"] for one in done)
    words = f"{failed} never at rest, else {slowest * 1e3:.0f} ms at most beside braking ({worst})"
    if away := set(names) - set(ran):
        words += f"; did not run: {', '.join(sorted(away))}"
    return Row(
        f"commander silent while moving: SIGSTOP, SIGKILL; each of {len(names)} links",
        min(sum(one["tried"] for one in done if one["name"] == name) for name in names), 1000, "times", words,
        "at rest within 100 ms + braking time", not failed and not away and slowest <= 0.1,
    )  # fmt: skip


def _drop(name: str, seed: int, count: int) -> dict[str, Any]:
    from middleware import links

    del seed
    peer: Any = links.PEERS[name]()
    peer.script = Path(__file__)
    slowest, failed = 0.0, 0
    try:
        try:
            peer.start()
        except pytest.skip.Exception:  # its middleware is not installed
            return {"name": name, "tried": 0, "slowest": 0.0, "failed": 0}
        robot = _Said(peer.process)
        command = [sys.executable, __file__, peer.link_via, "swing"]
        with subprocess.Popen(command) as mover:
            for index in range(count):
                robot.forget()
                if robot.hears("moves") is None:
                    raise LinkError(f"{name}: it never moves")
                begin = time.monotonic()
                mover.send_signal(signal.SIGKILL if index == count - 1 else signal.SIGSTOP)
                rest = robot.hears("rests", after=begin)
                failed += rest is None
                slowest = max(slowest, (rest or begin) - begin - _braking())
                mover.send_signal(signal.SIGCONT)
    finally:
        peer.stop()
    return {"name": name, "tried": count, "slowest": slowest, "failed": failed}


def _braking() -> float:
    """Time [s] that the servo's limits allow it for a stop from `SPEED`."""
    limits = next(servo.limits for servo in tci.load_robot("nao").servos if servo.name == SERVO)
    assert limits.acceleration is not None
    assert limits.jerk is not None
    return SPEED / limits.acceleration + limits.acceleration / limits.jerk


class _Said:
    """What the robot's process says: a word and a time [s] in each line."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._said: queue.Queue[tuple[str, float]] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, stamp = line.split()
            self._said.put((word, float(stamp)))

    def forget(self) -> None:
        while not self._said.empty():
            self._said.get()

    def hears(self, wanted: str, *, after: float = 0.0) -> float | None:
        """When it says a word, from `after` [s] on; None when it does not."""
        end = time.monotonic() + LONGEST
        while (left := end - time.monotonic()) > 0.0:
            try:
                word, stamp = self._said.get(timeout=left)
            except queue.Empty:
                return None
            if word == wanted and stamp >= after:
                return stamp
        return None


def serve(via: str) -> None:
    """A simulated NAO: says `moves` and `rests` by what its gate hands out."""
    from tci.middleware.simulated import SimulatedLink
    from tci.runtime.loop import Tick
    from tci.runtime.registry import open_server
    from tci.runtime.serve import serve

    state, since = "", 0.0
    robot = tci.load_robot("nao")
    servo = next(servo.index for servo in robot.servos if servo.name == SERVO)

    def tell(tick: Tick) -> None:
        nonlocal state, since
        if not state:
            print("ready", flush=True)
        here = np.flatnonzero(tick.sent.servos == servo)
        speed = float(np.abs(tick.sent.velocity[here]).max(initial=0.0))
        now = "rests" if speed < STILL else "moves" if speed > 0.9 * SPEED else "between"
        if now == "moves" and state == "moves":
            since += 1
            if since == 50:  # for some time: not while it turns
                print("moves", time.monotonic(), flush=True)
        elif now == "rests" and state != "rests":
            print("rests", time.monotonic(), flush=True)
        since = since if now == "moves" else 0
        state = now

    with SimulatedLink(robot, paced=True) as link, open_server(link, via) as server:
        serve(server, observe=tell)


def swing(via: str) -> None:
    """Moves one joint to and fro, for ever."""
    with tci.connect(tci.load_robot("nao"), via, arm=True) as link:
        arm = link.native("LArm")
        goal = 0
        for now in link.ticks():
            joints = link.read().joints
            if abs(arm.positions(joints)[SERVO] - ENDS[goal]) < 0.02:
                goal = 1 - goal
            link.write(link.gate.step([arm.command({SERVO: ENDS[goal]}, speed=SPEED)], joints, now))


if __name__ == "__main__":
    (swing if sys.argv[2:] == ["swing"] else serve)(sys.argv[1])
