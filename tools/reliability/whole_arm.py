"""Pokes both arms of every robot at random places. The reflex must respond to nearly all pokes, and never
move towards the finger."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from pool import gather
from row import Row

import tci
from tci.lab.experiments.arm_trials import arm_trials_of

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
JOB = 50
"""Number of pokes in a job."""
LEAST = 0.95
"""Least fraction of each robot's pokes to which the reflex must respond."""


def whole_arm(full: bool) -> Row:
    """Pokes forearms and upper arms with 0.5 to 10 N, 1000 times on each robot."""
    jobs = [(name, seed) for seed in range(1000 // JOB if full else 1) for name in ROBOTS]
    done = [trial for job in gather("whole_arm", _poke, jobs, full=full) for trial in job["trials"]]
    answered = {name: [one["answered"] for one in done if one["robot"] == name] for name in ROBOTS}
    shares = {name: sum(own) / max(len(own), 1) for name, own in answered.items()}
    towards = [one for one in done if one["towards"]]
    print(*(one for one in done if one["towards"] or not one["answered"]), sep="\n")
    words = ", ".join(f"{name} {share:.1%}" for name, share in shares.items())
    return Row(
        f"withdrawal reflex to pokes anywhere on the arms of {len(ROBOTS)} robots",
        len(done),
        1000 * len(ROBOTS),
        "pokes",
        f"pokes answered: {words}; {len(towards)} motions towards the finger",
        f"{LEAST:.0%} answered on each robot, 0 motions towards the finger",
        not towards and min(shares.values()) >= LEAST,
    )


def _poke(name: str, seed: int) -> dict[str, Any]:
    trials = arm_trials_of(tci.load_robot(name), tci.WithdrawalReflex(), count=JOB, seed=seed)
    return {"trials": [{"robot": name, **asdict(trial)} for trial in trials]}
