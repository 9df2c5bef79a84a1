"""How the size of a withdrawal changes what a person feels who stands in its way, or is clamped there.

python tools/reflex_people.py [--robots nao g1] [--seeds 60] [--sizes 0.5 0.75 1 1.25 1.5] [--json FILE]

Fingers poke arms at random places, and a part of a person with the stiffness and mass of one of six regions
stands where the withdrawal would strike at full speed (the row `bystander` of docs/reliability.md). The same
trial is run with base motions of each size, each behind the real gate and at the speed that the reflex itself
chooses; once with a person who is free to move, once with one who can't give way. Tables hold the mean of the
peaks, the largest peak, and the mean force in the last 20 ms, all in N.
"""

from __future__ import annotations

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from reflex_search import Candidate

import tci
from helpers.struck import draw, strike


def trial(robot_name: str, seed: int, *, sizes: tuple[float, ...]) -> list[list[list[float]]] | None:
    """Peak and late force (free and clamped, sizes, 2) [N]; None where nobody would be struck."""
    robot, fast = tci.load_robot(robot_name), tci.WithdrawalReflex(people=())
    one = draw(robot, seed, fast, full=seed % 2 == 0)
    if one is None:
        return None
    before = strike(robot, one, fast)
    if before.first is None or before.begun is None or before.first < before.begun:
        return None
    clamped = replace(one, region=replace(one.region, mass=None))  # type: ignore[arg-type]
    found = []
    for who in (one, clamped):
        blows = [strike(robot, who, Candidate(size, size, size).reflex(spares=True)) for size in sizes]
        found.append([[blow.peak, blow.late] for blow in blows])
    return found


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--robots", nargs="+", default=["nao", "g1"])
    words.add_argument("--seeds", type=int, default=60)
    words.add_argument("--sizes", type=float, nargs="+", default=[0.5, 0.75, 1.0, 1.25, 1.5])
    words.add_argument("--processes", type=int, default=1)
    words.add_argument("--json", type=Path)
    given, told = words.parse_args(), list[dict[str, Any]]()
    with ProcessPoolExecutor(given.processes) as pool:
        for name in given.robots:
            work = partial(trial, name, sizes=tuple(given.sizes))
            found = np.array([one for one in pool.map(work, range(given.seeds)) if one is not None])
            for k, who in enumerate(("free to move", "can't give way") if len(found) else ()):
                for size, rows in zip(given.sizes, found[:, k].swapaxes(0, 1), strict=True):
                    mean, late = rows.mean(axis=0).round(1).tolist()
                    most = round(float(rows[:, 0].max()), 1)
                    told.append({"robot": name, "who": who, "trials": len(found), "motions": size,
                                 "peak_N": mean, "largest_N": most, "late_N": late})  # fmt: skip
                    print(told[-1], flush=True)
            if not len(found):
                print(f"{name}: nobody would be struck in {given.seeds} trials", flush=True)
    if given.json:
        given.json.write_text(json.dumps(told, indent=1))


if __name__ == "__main__":
    main()
