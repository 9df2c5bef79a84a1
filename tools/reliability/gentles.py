"""Lets arms on their way meet partners on springs, who stand or move."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row

from helpers.gentled import meet

ROBOTS = "nao", "icub", "g1", "talos", "alex"
FULL, SMALL = 40, 2
"""Partners of each robot for each cap."""


def gentles(full: bool) -> Row:
    """The bar of a standing partner of 10 to 75 N/mm decides; a moving hand (pad 1.5 N/mm, up to 0.2 m/s) is
    measured beside it. Only partners count whom skin feels."""
    jobs = [
        (name, seed, cap, moves)
        for seed in range(FULL if full else SMALL)
        for name in ROBOTS
        for cap in ((5.0, 10.0, 15.0) if full else (10.0,))
        for moves in (False, True)
    ]
    done = [one for one in gather("gentles", _one, jobs, full=full) if one["counts"]]
    standing, moving = ([one for one in done if one["moves"] is moves] for moves in (False, True))
    over = [one for one in standing if one["late"] > one["cap"] + max(0.1 * one["cap"], one["step"])]
    print(*over, sep="\n")
    beyond = [one["high"] - one["cap"] for one in moving] or [np.nan]
    kept = [one["kept"] for one in standing] or [np.nan]
    return Row(
        "what an arm on its way presses with, on a plant that shares nothing with the gate",
        len(standing),
        FULL * len(ROBOTS) * 3,
        "partners",
        f"{len(over)} over; {sum(one['late'] > 1.1 * one['cap'] for one in standing)} over the cap by more "
        f"than 10 % but within a step of the encoders; contact kept {np.median(kept):.0%} of the time; "
        f"{sum(one['left'] >= 2.0 for one in standing)} did not reach the goal; moving hand: 95th percentile "
        f"{np.median(beyond):.0f} N above the cap (median), {np.max(beyond):.0f} N (worst)",
        "1 s after the first contact at most the cap and 10 %, or one step of the encoders if that is more",
        not over,
    )


def _one(name: str, seed: int, cap: float, moves: bool) -> dict[str, Any]:
    random = np.random.default_rng([seed, int(cap)])
    stiffness = 1.5e3 if moves else float(np.exp(random.uniform(np.log(10e3), np.log(75e3))))
    met = meet(
        name, 100 + seed, cap=cap, stiffness=stiffness, speed=random.uniform(0.05, 0.2) if moves else 0.0
    )
    about = {"robot": name, "seed": seed, "cap": cap, "moves": moves, "counts": met is not None and met.felt}
    if met is None:
        return about
    return {
        **about, "stiffness": stiffness, "peak": met.peak, "late": met.late, "high": met.high,
        "step": met.step, "kept": met.kept, "left": met.left,
    }  # fmt: skip
