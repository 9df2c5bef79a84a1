"""Touches random places of any robot in any posture. No response may increase the contact force."""

from __future__ import annotations

import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pool import gather
from row import Row

import tci
from helpers.pressing import NEXT, tally

TOUCHES = 10_000
"""Number of touches at full size, over all robots."""


def moves_away(full: bool) -> Row:
    """Checks the reflexes and the soft reaction, on the robots' own skin and on pads at random places and
    angles."""
    names, per_job = tci.robot_names(), 50 if full else 5
    seeds = -(-TOUCHES // (per_job * len(names))) if full else 1
    jobs = [(name, seed, per_job) for seed in range(seeds) for name in names]
    done = gather("moves_away", _touch, jobs, full=full)
    touches, answered, refused = (sum(one[key] for one in done) for key in ("touches", "answered", "refused"))
    rises = [rise for one in done for rise in one["rises"]]
    worst = max((one["worst"] for one in done), default=0.0)
    words = f"{answered} touches answered, {refused} refused with a reason; "
    words += f"{len(rises)} motions raised the contact force; largest rise {worst:.2g} N"
    print(*rises, sep="\n")
    return Row(
        f"reflexes of {len(names)} robots to touches at random places", touches, TOUCHES, "touches", words,
        f"0 motions raise the contact force within {NEXT * 1e3:.0f} ms", not rises and answered > 0,
    )  # fmt: skip


def _touch(name: str, seed: int, count: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        return asdict(tally(name, seed, count, Path(folder)))
