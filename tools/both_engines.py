"""Compares worlds of mujoco-warp (extra `batch`) with those of `mujoco.batch`: the same pokes, and how the
withdrawal reflex answers them over 5 s.

    python tools/both_engines.py nao icub g1 --pokes 320
    python tools/both_engines.py nao --pokes 16 --device cpu
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tests")]

from helpers.both_engines import compare_pokes, compare_withdrawals
from tci.batch.scene import batch_scene


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("robots", nargs="+")
    parser.add_argument("--pokes", type=int, default=320, help="worlds, each with a poke")
    parser.add_argument("--answered", type=int, default=16, help="worlds with the reflex")
    parser.add_argument("--seconds", type=float, default=5.0, help="of the reflex")
    parser.add_argument("--device", help="of Warp; by default the first GPU")
    parser.add_argument("--seed", type=int, default=7)
    args = parser.parse_args()
    for name in args.robots:
        begin = time.monotonic()
        one = compare_pokes(batch_scene(name, step=0.002), args.pokes, args.device, args.seed)
        took = time.monotonic() - begin
        print(
            f"{name}: forces on taxels differ by {np.median(one.differences):.1e} of the largest (median of "
            f"{len(one.differences)} frames), {np.percentile(one.differences, 99):.1e} (99 of 100)\n"
            f"  touched frames {one.touched}, more than 20 ms from begin and end {one.inner}\n"
            f"  of these the same contacts on the same taxels {one.same_taxels}, also forces within 1 % "
            f"{one.same_forces}\n"
            f"  contacts that begin in the same step {one.same_begin} of {args.pokes}; {took:.0f} s",
            flush=True,
        )
        if not args.answered:
            continue
        scene = batch_scene(name, step=0.002, period=0.02)
        answers = compare_withdrawals(scene, args.answered, args.device, args.seed, args.seconds, 2.4)
        print(
            f"  withdrawals in {args.seconds:g} s {answers.begun[0]} and {answers.begun[1]}, together "
            f"{answers.together}, first targets within {answers.first.max():.1e} rad (median "
            f"{np.median(answers.first):.1e}); {time.monotonic() - begin:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()
