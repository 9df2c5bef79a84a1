"""Sends hostile commands in each control mode to robots of rigid bodies that the gate knows only roughly."""

from __future__ import annotations

from collections import Counter
from typing import Any

from pool import gather
from row import Row

import tci
from helpers.four_modes import FourModes
from tci.messages import CONTROL_MODES, Mode

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
CYCLES = 10_000


def modes(full: bool) -> Row:
    """Shares 1e6 cycles of each mode among the bodies that have it; other masses, servos and delays each."""
    jobs = []
    for mode in CONTROL_MODES:
        bodies = [name for name in ROBOTS if any(mode in one.modes for one in tci.load_robot(name).servos)]
        runs = 1_000_000 // CYCLES if full else len(bodies)
        jobs += [(bodies[k % len(bodies)], mode.value, k, CYCLES if full else 500) for k in range(runs)]
    done = gather("modes", _one, jobs, full=full)
    bad = [one for one in done if one["faults"]]
    for one in bad:
        print(one["robot"], one["mode"], one["seed"], *one["faults"], sep="; ")
    runs_of, bad_of = Counter(one["mode"] for one in done), Counter(one["mode"] for one in bad)
    words = ", ".join(
        f"{mode} {bad_of[mode]} of {count} runs outside, largest speed "
        f"{max(one['speed'] for one in done if one['mode'] == mode):.2f} of its limit"
        for mode, count in runs_of.items()
    )
    return Row(
        "hostile commands in 4 modes to robots of rigid bodies, on a plant that shares nothing with the gate",
        sum(one["cycles"] for one in done),
        4e6,
        "cycles",
        words,
        "true positions, speeds and energy at most 1.05 of a limit, speeds in torque mode 1.3 for at most "
        "20 ms; without readings energy grows by at most 10 %; no overlap, no false STOP",
        not bad,
    )


def _one(name: str, mode: str, seed: int, cycles: int) -> dict[str, Any]:
    trial = FourModes(tci.load_robot(name), Mode(mode), seed, rate=(200.0, 500.0)[seed // len(ROBOTS) % 2])
    for _ in range(cycles):
        trial.step()
    return {
        "robot": name, "mode": mode, "seed": seed, "cycles": trial.seen.cycles, "speed": trial.seen.speed,
        "faults": trial.seen.faults(Mode(mode)),
    }  # fmt: skip
