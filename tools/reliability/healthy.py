"""Moves healthy but dirty robots at full speed, in every mode, and counts false faults and contacts."""

from __future__ import annotations

from collections import Counter
from typing import Any

from pool import gather
from row import Row

import tci
from helpers.healthy import Healthy
from tci.messages import CONTROL_MODES, Mode

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
RATES = (200.0, 500.0, 100.0)
LASTS, PIECE = 600.0, 20.0
"""Time [s] that each robot moves in each mode, and time [s] of one job."""


def healthy(full: bool) -> Row:
    """Other masses, servos, delays and encoders in each piece."""
    pieces, lasts = (round(LASTS / PIECE), PIECE) if full else (1, 4.0)
    pairs = [
        (name, mode)
        for name in ROBOTS
        for mode in CONTROL_MODES
        if any(mode in one.modes for one in tci.load_robot(name).servos)
    ]
    jobs = [(name, mode.value, seed, lasts) for seed in range(pieces) for name, mode in pairs]
    done = gather("healthy", _one, jobs, full=full)
    for one in done:
        for words, count in one["alarms"].items():
            print(f"{one['robot']}, {one['mode']}, {one['seed']}: {count} times {words}")
    stops, met = Counter[str](), Counter[str]()
    for one in done:
        for words, count in one["alarms"].items():
            (stops if words.startswith(("stop", "hold")) else met)[one["robot"]] += count
    return Row(
        "false alarms of healthy robots that move at full speed: coarse, late and doubled readings, masses "
        "20 % off, dry friction, 0.3 kg that nobody declared",
        sum(one["lasts"] for one in done) / 60.0,
        len(pairs) * LASTS / 60.0,
        "minutes",
        f"{stops.total()} stops and holds{_by(stops)}, {met.total()} contacts{_by(met)}",
        "0 stops, 0 contacts",
        not (stops or met),
    )


def _by(found: Counter[str]) -> str:
    words = ", ".join(f"{name} {count}" for name, count in found.items())
    return f" ({words})" if words else ""


def _one(name: str, mode: str, seed: int, lasts: float) -> dict[str, Any]:
    trial = Healthy(tci.load_robot(name), Mode(mode), seed, rate=RATES[seed % len(RATES)])
    trial.run(lasts)
    return {"robot": name, "mode": mode, "seed": seed, "lasts": lasts, "alarms": dict(trial.alarms)}
