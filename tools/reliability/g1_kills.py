"""Kills processes that control a G1's motors at random moments. The robot must receive a complete fade of the
command weight to zero.

The judgement uses only the sequence of commands that the robot received, not processor times.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pool import Result, gather
from report import ROOT
from row import Row

from tci.messages.frames import Array
from tci.shared.interface_node import MOST, InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.handover import GIVE, TAKE
from tci.wires.unitree.wire import STATE, WEIGHT, decode_command, encode_state

AT_ONCE = 6
"""Number of robots that are simulated at the same time, each in a separate DDS domain. Assumed: one processor
is fast enough for this number."""
EACH = 50
"""Number of kills in one job."""
DOMAIN = 130
"""DDS domain of the first robot."""
STATES = 0.01
"""Time [s] between two state messages of a robot, and between two commands. Assumed: long enough for all
robots to share a machine."""
LEADS = 1.0
"""Longest time [s] from the end of the weight's ramp to a kill."""
EARLY = 5
"""In one of so many trials, the time of the kill counts from the request for the motors. In all other trials
it counts from the first command that the robot receives."""
START = 60.0
"""Longest time [s] from the start of a process to the moment from which its kill is timed. A process that
needs longer is started again. Assumed: enough for a busy machine."""
TRIES = 5
"""Number of starts after which a trial counts as failed."""
SILENCE = 1.0, 5.0
"""Times [s] without a command after which a trial ends: the first if the robot has never received a command,
the second if it has. Assumed: longer than a process on a busy machine stands still."""
AFTER = 0.3
"""Time [s] for which a robot still reads commands after it has received weight 0."""
STEP = 0.05
"""Largest accepted decrease of the weight between two commands, beyond that of the ramp. Assumed: some
commands may be lost."""
HOLDER = ROOT / "tests" / "helpers" / "motor_holder.py"


@dataclass
class Heard:
    """Commands that one robot received: times [s], weights, and all set-points of waist and arms (5, 17)."""

    times: list[float] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)
    targets: list[Array] = field(default_factory=list)
    wrong: int = 0


@dataclass
class Trial:
    """One process that controls the motors, and the robot in the DDS domain of this process."""

    early: bool
    wait: float
    """Time [s] from the moment `began` to the kill."""
    tries: int = 0
    started: float = 0.0
    process: int | None = None
    asked: bool = False
    """True after the process has requested the motors."""
    began: float | None = None
    killed: float | None = None
    failed: bool = False
    """True if the process ended before it was killed."""
    heard: Heard = field(default_factory=Heard)

    def start(self, now: float) -> None:
        self.tries, self.started, self.failed = self.tries + 1, now, False
        self.asked = False
        self.process = self.began = self.killed = None
        self.heard = Heard()

    def step(self, now: float) -> bool:
        """Kills the process when the time has come. Returns True at the end of the trial."""
        if self.killed is not None:
            return self._over(now)
        if self.began is None and (self.heard.times or (self.early and self.asked)):
            self.began = now
        if self.failed or now > self.started + START + (0.0 if self.began is None else self.wait):
            self.failed, self.killed = True, now
        elif self.process and self.began is not None and now > self.began + self.wait:
            self.killed = now
        if self.killed is not None and self.process:
            try:
                os.kill(self.process, signal.SIGKILL)
            except ProcessLookupError:
                self.failed = True
        return False

    def _over(self, now: float) -> bool:
        assert self.killed is not None
        never, last = SILENCE
        if not self.heard.times:
            return now > self.killed + never
        return now > self.heard.times[-1] + (AFTER if self.heard.weights[-1] == 0.0 else last)

    def fault(self) -> str:
        """Returns the fault of the commands that the robot received; empty if there is none."""
        heard = self.heard
        if not heard.times:
            return ""
        times, weights, targets = (np.array(one) for one in (heard.times, heard.weights, heard.targets))
        fall = -np.diff(weights)
        # Entry i is True if command i + 1 lowers the weight. If the robot sends no states, the weight also
        # falls, and rises again later.
        fading = fall > 0.0
        faded, goes_on = targets[1:][fading], fading[:-1] & fading[1:]
        if heard.wrong:
            return f"{heard.wrong} wrong checksums"
        if weights[-1] != 0.0:
            return f"its last weight is {weights[-1]:.3f}"
        if (fall > np.diff(times) / GIVE + STEP).any():
            return f"its weight falls by {fall.max():.3f} at once"
        angles, rates, gains = targets[1:, 0], faded[:, 1:3], faded[:, 3:]
        if np.diff(angles, axis=0)[goes_on].any() or rates.any():
            return "its targets move during the fade"
        if not (gains > 0.0).all():
            return f"its gains vanish: {gains.min():.2f}"
        return ""


class Robots:
    """Simulated robots that consist only of DDS topics, all in one thread, and the processes that control
    their motors."""

    def __init__(self) -> None:
        self._nodes = [InterfaceNode("lo", DOMAIN + number) for number in range(AT_ONCE)]
        self._states = [node.out("rt/lowstate", messages.STATE) for node in self._nodes]
        self._commands = [
            node.reader("rt/arm_sdk", messages.COMMAND, keep=MOST, reliable=True) for node in self._nodes
        ]
        self.trials: list[Trial | None] = [None] * AT_ONCE
        state: Any = np.zeros((), STATE)
        state["mode_machine"], state["quaternion"][0] = 5, 1.0
        self._state = encode_state(state)
        self._due = time.monotonic()
        self._holders = subprocess.Popen(
            [sys.executable, str(HOLDER), "-"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
        assert self._holders.stdin is not None
        assert self._holders.stdout is not None
        self._ask, self._answers = self._holders.stdin, self._holders.stdout.fileno()
        os.set_blocking(self._answers, False)
        self._rest = b""

    def start(self, place: int, trial: Trial) -> None:
        """Starts the process of a trial in the DDS domain number `place`, which must be free."""
        self.trials[place] = trial
        trial.start(time.monotonic())
        self._ask.write(f"{DOMAIN + place} {STATES}\n")
        self._ask.flush()

    def step(self) -> float:
        """Sends states if they are due, and reads all commands. Returns the present time [s]."""
        time.sleep(0.002)
        if (now := time.monotonic()) >= self._due:
            self._due = max(self._due + STATES, now)
            for send in self._states:
                send(self._state)
        for trial, reader in zip(self.trials, self._commands, strict=True):
            for sample in latest(reader):
                if trial is None:
                    continue
                command, right = decode_command(sample.raw)
                motor, heard = command["motor"], trial.heard
                heard.times.append(now)
                heard.weights.append(float(motor["q"][WEIGHT]))
                rows = [motor[name][12:29] for name in ("q", "dq", "tau", "kp", "kd")]
                heard.targets.append(np.array(rows, dtype=float))
                heard.wrong += not right
        self._hear()
        return now

    def _hear(self) -> None:
        """Reads the lines that the processes print."""
        try:
            self._rest += os.read(self._answers, 65536)
        except BlockingIOError:
            return
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            domain, process, word = line.decode().split()
            trial = self.trials[int(domain) - DOMAIN]
            if trial is None:
                continue
            if word == "begun":
                trial.process = int(process)
            if trial.process == int(process):
                trial.asked |= word == "asked"
                trial.failed |= word == "failed"

    def close(self) -> None:
        for trial in self.trials:
            if trial is not None and trial.process and trial.killed is None:
                os.kill(trial.process, signal.SIGKILL)
        self._ask.close()
        self._holders.wait()
        for node in self._nodes:
            node.close()


def unitree_kills(full: bool) -> Row:
    """Kills processes that control the motors of robots, for several robots at a time."""
    jobs = [(number, EACH) for number in range(1000 // EACH)] if full else [(0, 20)]
    done = gather("unitree_kills", _kills, jobs, full=full, alone=True)
    keys = "kills", "taken", "faults", "again"
    kills, taken, faults, again = (sum(one[key] for one in done) for key in keys)
    slowest = max((one["slowest"] for one in done), default=0.0)
    return Row(
        "kill -9 of processes that command a G1's arms",
        kills,
        1000,
        "kills",
        f"{taken} kills after the process had taken over the arms; {kills - faults} kills without a fault; "
        f"last message after at most {slowest:.2f} s; {again} starts repeated",
        "after every kill the weight falls to 0 without a step",
        bool(kills) and not faults,
    )


def _kills(number: int, count: int) -> Result:
    """Starts processes, kills each at a different moment, and judges the commands that their robots
    received."""
    chance, robots = random.Random(number), Robots()
    waits = [chance.uniform(0.0, TAKE + LEADS) for _ in range(count)]
    waiting = deque(Trial(early=place % EARLY == 0, wait=wait) for place, wait in enumerate(waits))
    found: Result = {"kills": 0, "taken": 0, "faults": 0, "what": [], "slowest": 0.0, "again": 0}
    try:
        while waiting or any(robots.trials):
            now = robots.step()
            for place, trial in enumerate(robots.trials):
                if trial is not None and trial.step(now):
                    if not _count(trial, found):
                        waiting.append(trial)
                    robots.trials[place] = trial = None
                if trial is None and waiting:
                    robots.start(place, waiting.popleft())
    finally:
        robots.close()
    return found


def _count(trial: Trial, found: Result) -> bool:
    """Counts a trial. Returns False if the trial must be repeated."""
    assert trial.killed is not None
    fault = trial.fault()
    if trial.failed and not fault:
        if trial.tries < TRIES:
            found["again"] += 1
            return False
        fault = f"its process did not take the motors in {TRIES} starts"
    found["kills"] += 1
    found["taken"] += bool(trial.heard.times)
    found["faults"] += bool(fault)
    found["what"] += [fault] if fault else []
    if trial.heard.times:
        found["slowest"] = max(found["slowest"], trial.heard.times[-1] - trial.killed)
    return True
