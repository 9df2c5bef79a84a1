"""Lets hands guide arms, tap, and compares what the arms repeat."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row

from helpers.taught import guide

ROBOTS = "nao", "icub", "g1", "g1-inspire", "talos", "alex"
FULL, SMALL = 40, 3
"""Places that are tried on each robot. At most of them, or of their postures, an arm can't go at 0.2 m/s."""


def teaches(full: bool) -> Row:
    """Bars: force, contact, and what is repeated after a tap that skin felt."""
    jobs = [(name, 1000 + seed) for seed in range(FULL if full else SMALL) for name in ROBOTS]
    done = [one for one in gather("teaches", _one, jobs, full=full) if one["counts"]]
    over = [one for one in done if one["median"] > 5.0 or one["high"] > 8.0 or one["kept"] < 0.95]
    tapped = [one for one in done if one["tapped"]]
    off = [one for one in tapped if not one["off"] <= 2.0]
    print(*over, *off, sep="\n")
    median, high, kept, away = (
        [one[name] for one in rows] or [np.nan]
        for name, rows in (("median", done), ("high", done), ("kept", done), ("off", tapped))
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
        f"over, {len(off)} not repeated; measured for less than 0.8 s: "
        f"{', '.join(f'{count} by {why}' for why, count in short.items()) or 'none'}",
        "after 0.3 s at each place: median <= 5 N, 95th percentile <= 8 N, contact >= 95 %; repeated "
        "within 2 degrees r.m.s.",
        not over and not off,
    )


def _one(name: str, seed: int) -> dict[str, Any]:
    seen = guide(name, seed)
    about = {"robot": name, "seed": seed, "counts": seen is not None}
    if seen is None:
        return about
    return {
        **about, "patch": seen.patch, "rate": seen.rate, "pad": seen.pad, "median": seen.median,
        "high": seen.high, "kept": seen.kept, "peak": seen.peak, "tapped": seen.tapped, "off": seen.off,
        "why": seen.why,
    }  # fmt: skip
