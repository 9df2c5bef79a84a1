"""Pokes both arms of every robot at random places. The skin must leave the finger within a
second or the reflex say why, and never move towards the finger."""

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
"""Least fraction of each robot's pokes in which the skin must leave the finger within a second."""


def whole_arm(full: bool) -> Row:
    """Pokes forearms and upper arms with 0.5 to 10 N, 1000 times on each robot."""
    jobs = [(name, seed) for seed in range(1000 // JOB if full else 1) for name in ROBOTS]
    done = [trial for job in gather("whole_arm", _poke, jobs, full=full) for trial in job["trials"]]
    left = {name: [one["left"] for one in done if one["robot"] == name] for name in ROBOTS}
    shares = {name: sum(own) / max(len(own), 1) for name, own in left.items()}
    unsaid = [one for one in done if not one["left"] and not one["reason"]]
    towards = [one for one in done if one["towards"]]
    print(*(one for one in done if one["towards"] or not one["left"]), sep="\n")
    words = ", ".join(f"{name} {share:.1%}" for name, share in shares.items())
    return Row(
        f"withdrawal reflex to pokes anywhere on the arms of {len(ROBOTS)} robots",
        len(done),
        1000 * len(ROBOTS),
        "pokes",
        f"fingers left within 1 s: {words}; {len(unsaid)} not left without a reason, {len(towards)} motions "
        "towards the finger",
        f"{LEAST:.0%} left on each robot, the others with a reason, 0 motions towards the finger",
        not towards and not unsaid and min(shares.values()) >= LEAST,
    )


def _poke(name: str, seed: int) -> dict[str, Any]:
    trials = arm_trials_of(tci.load_robot(name), tci.WithdrawalReflex(), count=JOB, seed=seed)
    return {"trials": [{"robot": name, **asdict(trial)} for trial in trials]}
