"""Lets arms on their way meet partners on springs, who stand or move."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row

import tci
from helpers.gentled import meet
from tci.body import Struck, first_peak

ROBOTS = "nao", "icub", "g1", "g1-inspire", "talos", "alex"
FULL, SMALL = 40, 2
"""Partners of each robot for each cap."""
KINDS = "stands", "moves", "hand"
"""A partner, one whose way nothing changes, and a hand of 0.6 kg that an arm of 300 N/m moves."""
WALL = 1e6
"""Mass [kg] of one who can't move away."""


def gentles(full: bool) -> Row:
    """Partners of 10 to 75 N/mm who stand, and hands (pads of 1 to 2 N/mm, up to 0.2 m/s) that move. Only
    those count whom skin feels."""
    jobs = [
        (name, seed, cap, kind)
        for seed in range(FULL if full else SMALL)
        for name in ROBOTS
        for cap in ((5.0, 10.0, 15.0) if full else (10.0,))
        for kind in KINDS
    ]
    done = [one for one in gather("gentles", _one, jobs, full=full) if one["counts"]]
    standing, moving = ([one for one in done if one["moves"] is moves] for moves in (False, True))
    over = [one for one in standing if one["late"] > one["cap"] + max(0.1 * one["cap"], one["step"])]
    harder = [one for one in moving if one["high"] > one["cap"] + 10.0]
    lost = [one for one in done if one["kept"] < 0.9]
    away = [one for one in done if one["arrives"] == np.inf]
    told = [one["predicted"] / one["first"] for one in standing if np.isfinite(one["predicted"])]
    near = sum(abs(one - 1.0) <= 0.25 for one in told)
    print(*over, *harder, *lost, *away, sep="\n")
    beyond = [one["high"] - one["cap"] for one in moving] or [np.nan]
    kept = [one["kept"] for one in done] or [np.nan]
    arrives = [one["arrives"] for one in done if one not in away] or [np.nan]
    return Row(
        "what an arm on its way presses with, on a plant that shares nothing with the gate",
        len(standing),
        FULL * len(ROBOTS) * 3,
        "partners",
        f"{len(over)} over; {sum(one['late'] > 1.1 * one['cap'] for one in standing)} over the cap by more "
        f"than 10 % but within a step of the encoders; contact kept {np.median(kept):.0%} of the time "
        f"(median), less than 90 % by {len(lost)}; {len(moving)} moving hands: 95th percentile "
        f"{np.median(beyond):.0f} N above the cap (median), {np.max(beyond):.0f} N (worst), {len(harder)} "
        f"over; the first peak predicted within 25 % {near} of {len(told)} times; {len(away)} did not reach "
        f"the goal, the others {np.median(arrives):.1f} s (median), "
        f"{np.max(arrives):.1f} s (slowest) after the partner had left",
        "1 s after the first contact at most the cap and 10 %, or one step of the encoders if that is more; "
        "contact kept >= 90 % of the time (with a moving hand, while it comes); the first peak predicted, "
        "and within 25 % in 3 of 4; a moving hand's 95th percentile at most the cap and 10 N; "
        "the goal reached",
        not over and not harder and not lost and not away and bool(told) and near >= 0.75 * len(told),
    )


def _one(name: str, seed: int, cap: float, kind: str) -> dict[str, Any]:
    random, moves = np.random.default_rng([seed, int(cap)]), kind != "stands"
    stiffness = 1.5e3 if moves else float(np.exp(random.uniform(np.log(10e3), np.log(75e3))))
    speed = random.uniform(0.05, 0.2) if moves else 0.0
    if kind == "hand":
        stiffness = random.uniform(1e3, 2e3)
    met = meet(name, 100 + seed, cap=cap, stiffness=stiffness, speed=speed, free=kind == "hand")
    about = {
        "robot": name,
        "seed": seed,
        "cap": cap,
        "kind": kind,
        "moves": moves,
        "counts": met is not None and met.felt,
    }
    if met is None:
        return about
    predicted = float("nan")
    if met.felt and not moves and np.isfinite(met.closing):
        person = Struck(name="partner", stiffness=stiffness, mass=WALL, force=np.inf)
        predicted = first_peak(
            tci.GenericBody(name), met.joints, met.patch, met.taxel, speed=max(met.closing, 0.0),
            person=person, period=met.period,
        )  # fmt: skip
    return {
        **about, "stiffness": stiffness, "peak": met.peak, "first": met.first, "predicted": predicted,
        "late": met.late, "high": met.high, "step": met.step, "kept": met.kept, "left": met.left,
        "arrives": met.arrives,
    }  # fmt: skip
