"""Lets arms withdraw into somebody who stands in their way, and looks at the force of the blow."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row

import tci
from helpers.struck import draw, strike

ROBOTS = ("nao", "icub", "g1", "talos", "alex")
FULL, SMALL = 2400, 24
"""Seeds of a robot: one of six to nine strikes somebody at full speed, and so counts."""


def bystander(full: bool) -> Row:
    """Only trials count in which somebody is struck when the arm withdraws at its full speed. Half of the
    pokes ask for the reflex's full gain."""
    jobs = [(name, seed) for seed in range(FULL if full else SMALL) for name in ROBOTS]
    done = [one for one in gather("bystander", _one, jobs, full=full) if one["counts"]]
    over = [one for one in done if one["peak"] > 2.0 * one["limit"] or one["peak"] > one["told"]]
    print(*over, sep="\n")
    words = []
    for name in ROBOTS:
        own = [one for one in done if one["robot"] == name]
        largest, before = (max((one[key] for one in own), default=0.0) for key in ("peak", "before"))
        struck = sum(one["peak"] > 0.0 for one in own)
        words.append(f"{name} {len(own)} count, {struck} struck, {largest:.0f} N (full speed {before:.0f} N)")
    return Row(
        "somebody in the way of a withdrawal, on a plant that shares nothing with the gate",
        len(done),
        300 * len(ROBOTS),
        "trials",
        f"{len(over)} over; largest peaks: {'; '.join(words)}",
        "at most twice the region's limit, and never above what the reflex told before",
        not over,
    )


def told(memory: Any) -> float | None:
    """The bound that a withdrawal's memory has."""
    return max((one.pace.force for one in memory.values()), default=None)


def _one(name: str, seed: int) -> dict[str, Any]:
    robot, fast = tci.load_robot(name), tci.WithdrawalReflex(people=())
    trial = draw(robot, seed, fast, full=seed % 2 == 0)
    if trial is None:
        return {"robot": name, "counts": False}
    before = strike(robot, trial, fast)
    if before.first is None or before.begun is None or before.first < before.begun:
        return {"robot": name, "counts": False}
    after = strike(robot, trial, tci.WithdrawalReflex(), told=told)
    return {
        "robot": name, "seed": seed, "counts": True, "region": trial.region.name, "limit": trial.region.limit,
        "before": before.peak, "peak": after.peak, "late": after.late,
        "told": np.inf if after.told is None else after.told,
    }  # fmt: skip
