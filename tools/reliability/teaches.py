"""Lets hands guide arms, tap, and compares what the arms repeat."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row

from helpers.taught import ends_with_a_tap, guide, hands_apart
from tci.gestures import fit

ROBOTS = "nao", "icub", "g1", "g1-inspire", "talos", "alex"
FULL, SMALL = 40, 3
"""Places that are tried on each robot. At most of them, or of their postures, an arm can't go at 0.2 m/s."""
SLOW = 25.0
"""Rate [Hz] of loops that count as slow, at a third of as many places."""


def teaches(full: bool) -> Row:
    """Bars: force, contact, and what is repeated after a tap that skin felt; in slow loops, force only."""
    jobs = [(name, 1000 + seed) for seed in range(FULL if full else SMALL) for name in ROBOTS]
    done = [one for one in gather("teaches", _one, jobs, full=full) if one["counts"]]
    jobs = [(name, 3000 + seed) for seed in range((FULL if full else SMALL) // 3) for name in ROBOTS]
    slow = [one for one in gather("slow", _slow, jobs, full=full) if one["counts"]]
    hard = [one for one in slow if one["high"] > 12.0 or one["state"] == "STOP"]
    over = [one for one in done if one["median"] > 5.0 or one["high"] > 8.0 or one["kept"] < 0.95]
    tapped = [one for one in done if one["tapped"]]
    stopped = [one for one in done if one["state"] == "STOP"]
    off = [one for one in tapped if not one["off"] <= 2.0]
    ends = gather("ends", _ends, [(number,) for number in range(120 if full else 10)], full=full)
    ends = [one for one in ends if one["ended"] is not None]
    missed = [one["number"] for one in ends if not one["ended"]]
    beyond = [one for one in tapped if not one["apart"] <= 10.0]
    far = [one for one in beyond if not one["apart"] - one["told"] <= 10.0]
    print(*over, *stopped, *off, *far, *hard, sep="\n")
    median, high, kept, away, apart = (
        [one[name] for one in rows] or [np.nan]
        for name, rows in (
            ("median", done),
            ("high", done),
            ("kept", done),
            ("off", tapped),
            ("apart", tapped),
        )
    )
    short = {
        why: sum(one["why"] == why for one in done) for why in sorted({one["why"] for one in done} - {""})
    }
    return Row(
        "how hard a hand pushes an arm that it teaches at 0.2 m/s, and what the arm repeats, on a plant that "
        "shares nothing with the gate",
        len(done),
        FULL * len(ROBOTS),
        "places",
        f"force {np.median(median):.1f} N (median), 95th percentile {np.median(high):.1f} N (median), "
        f"{np.max(high):.1f} N (worst); contact kept {np.min(kept):.0%} of the time or more; repeated within "
        f"{np.median(away):.1f} degrees (median), {np.max(away):.1f} (worst) of {len(tapped)}; {len(over)} "
        f"over, {len(stopped)} stopped the robot, {len(off)} not repeated; on {len(tapped)} other "
        f"robots the hand within {np.median(apart):.1f} degrees (median), {len(beyond)} over 10, of "
        f"which {len(far)} not since its own limits keep it away, which `fit` tells; the end "
        f"recognised {len(ends) - len(missed)} of {len(ends)} times; measured for less than 0.8 s: "
        f"{', '.join(f'{count} by {why}' for why, count in short.items()) or 'none'}; loops of 40 ms: 95th "
        f"percentile {max((one['high'] for one in slow), default=np.nan):.1f} N (worst of {len(slow)}), "
        f"{sum(one['state'] == 'STOP' for one in slow)} stopped the robot",
        "after 0.3 s at each place: median <= 5 N, 95th percentile <= 8 N, contact >= 95 %, no stop; "
        "repeated within 2 degrees r.m.s., on another robot the hand's direction from the shoulder within 10 "
        "degrees; the end recognised 98 of 100 times; in loops of 40 ms 95th percentile <= 12 N, no stop",
        not (over or stopped or off or far or hard) and bool(slow) and len(missed) <= 0.02 * len(ends),
    )


def _one(name: str, seed: int) -> dict[str, Any]:
    seen = guide(name, seed)
    about = {"robot": name, "seed": seed, "counts": seen is not None}
    if seen is None:
        return about
    other = ROBOTS[(ROBOTS.index(name) + 1 + seed % (len(ROBOTS) - 1)) % len(ROBOTS)]
    apart = told = np.inf
    if seen.gesture is not None:
        apart = hands_apart(seen.gesture, name, other)
        missed = fit(other, seen.gesture).missed
        told = float(
            np.degrees(max((one for joint, one in missed.items() if "upper_arm" in joint), default=0.0))
        )
    return {
        **about, "other": other, "apart": apart, "told": told, "patch": seen.patch,
        "rate": seen.rate, "pad": seen.pad, "median": seen.median,
        "high": seen.high, "kept": seen.kept, "peak": seen.peak, "tapped": seen.tapped, "off": seen.off,
        "why": seen.why, "state": seen.state,
    }  # fmt: skip


def _slow(name: str, seed: int) -> dict[str, Any]:
    seen = guide(name, seed, repeat=False, slow=SLOW)
    about = {"robot": name, "seed": seed, "counts": seen is not None}
    if seen is None:
        return about
    return {**about, "patch": seen.patch, "median": seen.median, "high": seen.high, "kept": seen.kept,
            "state": seen.state, "why": seen.why}  # fmt: skip


def _ends(number: int) -> dict[str, Any]:
    return {
        "number": number,
        "ended": ends_with_a_tap(("nao", "icub", "g1", "talos", "alex")[number % 5], 1000 + number),
    }
