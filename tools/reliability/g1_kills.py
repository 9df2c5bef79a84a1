"""Processes that hold a G1's motors are killed at any instant: the robot must hear a completed fade."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pool import Result, gather
from report import ROOT
from row import Row

from tci.drivers.unitree import messages
from tci.drivers.unitree.handover import GIVE, KD, KP, TAKE, Q
from tci.drivers.unitree.node import MOST, UnitreeNode, latest
from tci.drivers.unitree.wire import STATE, WEIGHT, decode_command, encode_state
from tci.frames import Array

AT_ONCE = 20
"""Robots of one round, each in a DDS domain of its own. Assumed: as many as two processors serve."""
DOMAIN = 130
"""Domain of the first of them."""
STATES = 0.01
"""Time [s] between two states of a robot, and between two commands. Assumed: all robots share a machine."""
LEADS = 1.0
"""Longest time [s] from the end of the ramp to a kill."""
EARLY = 5
"""One in so many kills is timed from the moment at which the process asks for the motors, all others from the
first command that the robot hears."""
LATE = 4.0
"""Longest time [s] beyond the fade that is waited for its end, on a busy machine."""
STEP = 0.05
"""Fall of the weight between two commands beyond the ramp's. Assumed: a few commands that were lost."""
HOLDER = ROOT / "tests" / "drivers" / "unitree" / "holder.py"


@dataclass
class Heard:
    """Commands that one robot heard: times [s], weights, and all set-points of waist and arms (6, 17)."""

    times: list[float] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)
    targets: list[Array] = field(default_factory=list)
    wrong: int = 0


class Robots:
    """Robots of DDS topics alone, all in one thread."""

    def __init__(self, count: int) -> None:
        self.nodes = [UnitreeNode("lo", DOMAIN + number) for number in range(count)]
        self.states = [node.out("rt/lowstate", messages.STATE) for node in self.nodes]
        self.commands = [
            node.reader("rt/arm_sdk", messages.COMMAND, keep=MOST, reliable=True) for node in self.nodes
        ]
        self.heard = [Heard() for _ in self.nodes]
        state: Any = np.zeros((), STATE)
        state["mode_machine"], state["quaternion"][0] = 5, 1.0
        self._state = encode_state(state)
        self._due = time.monotonic()

    def step(self) -> float:
        """Sends states if they are due, and reads all commands; returns the time [s]."""
        time.sleep(0.002)
        if (now := time.monotonic()) >= self._due:
            self._due = max(self._due + STATES, now)
            for send in self.states:
                send(self._state)
        for heard, reader in zip(self.heard, self.commands, strict=True):
            for sample in latest(reader):
                command, right = decode_command(sample.raw)
                motor = command["motor"]
                heard.times.append(now)
                heard.weights.append(float(motor["q"][WEIGHT]))
                rows = [motor[name][12:29] for name in ("q", "dq", "tau", "kp", "kd")]
                heard.targets.append(np.array(rows, dtype=float))
                heard.wrong += not right
        return now

    def close(self) -> None:
        for node in self.nodes:
            node.close()


def unitree_kills(full: bool) -> Row:
    """Kills processes that hold the motors of robots, AT_ONCE at a time."""
    rounds = 1000 // AT_ONCE if full else 1
    done = gather("unitree_kills", _round, [(number,) for number in range(rounds)], full=full, alone=True)
    kills, taken, faults = (sum(one[key] for one in done) for key in ("kills", "taken", "faults"))
    slowest = max((one["slowest"] for one in done), default=0.0)
    return Row(
        "kill -9 of processes that hold a G1's arms", kills, 1000, "kills",
        f"{taken} after the arms were taken; {kills - faults} faded completely, within {slowest:.2f} s",
        "all fade to weight 0, without a step", bool(kills) and not faults,
    )  # fmt: skip


def _round(number: int) -> Result:
    """Starts a process for each robot, kills each at an instant of its own, and judges what the robots
    heard."""
    chance, robots = random.Random(number), Robots(AT_ONCE)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    started = [
        subprocess.Popen(
            [sys.executable, str(HOLDER), str(DOMAIN + place), str(STATES)],
            stdout=subprocess.PIPE, env=environment,
        )
        for place in range(AT_ONCE)
    ]  # fmt: skip
    began: dict[int, float] = {}
    killed: dict[int, float] = {}
    waits = [chance.uniform(0.0, TAKE + LEADS) for _ in started]
    until = time.monotonic() + 120.0
    try:
        for holder in started:
            os.set_blocking(holder.stdout.fileno(), False)  # type: ignore[union-attr]
        while (now := robots.step()) < until:
            for place, holder in enumerate(started):
                early = place % EARLY == 0 and b"asked" in (holder.stdout.read() or b"")  # type: ignore[union-attr]
                if place not in began and (early or robots.heard[place].times):
                    began[place] = now
                if place not in killed and now > began.get(place, np.inf) + waits[place]:
                    holder.kill()
                    killed[place] = now
            if len(killed) == AT_ONCE:
                until = min(until, max(killed.values()) + GIVE + LATE)
                if all(_over(heard, now, killed[place]) for place, heard in enumerate(robots.heard)):
                    break
    finally:
        for holder in started:
            holder.kill()
            holder.communicate()
        robots.close()
    found = [_judge(heard, killed.get(place, np.inf)) for place, heard in enumerate(robots.heard)]
    return {
        "kills": AT_ONCE,
        "taken": sum(bool(heard.times) for heard in robots.heard),
        "faults": sum(bool(fault) for fault, _ in found),
        "what": [fault for fault, _ in found if fault],
        "slowest": max(took for _, took in found),
    }


def _over(heard: Heard, now: float, killed: float) -> bool:
    """Returns True if nothing more is to come: silence since the kill, or after a weight of zero."""
    if not heard.times:
        return now > killed + 1.0
    return heard.weights[-1] == 0.0 and now > heard.times[-1] + 0.3


def _judge(heard: Heard, killed: float) -> tuple[str, float]:
    """Returns the fault of what one robot heard, or nothing; and the time [s] from the kill to the end."""
    if not np.isfinite(killed):
        return "its process never asked for the motors", 0.0
    if not heard.times:
        return "", 0.0
    times, weights, targets = (np.array(one) for one in (heard.times, heard.weights, heard.targets))
    took = max(0.0, float(times[-1]) - killed)
    fall, passed = -np.diff(weights), np.diff(times)
    fading = targets[np.flatnonzero(times > killed + 0.1)]
    if heard.wrong:
        return f"{heard.wrong} wrong checksums", took
    if weights[-1] != 0.0:
        return f"its last weight is {weights[-1]:.3f}", took
    if (np.append(fall, 0.0) > np.append(passed, 0.0) / GIVE + STEP).any():
        return f"its weight falls by {fall.max():.3f} at once", took
    if len(fading) and (np.ptp(fading[:, Q], axis=0).any() or fading[:, Q + 1 : KP].any()):
        return "its targets move during the fade", took
    if len(fading) and not (fading[:, KP:] > 0.0).all():
        return f"its gains vanish: {fading[:, KP : KD + 1].min():.2f}", took
    return "", took
