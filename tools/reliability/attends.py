"""Touches robots anywhere, and looks at where they look."""

from __future__ import annotations

from typing import Any

import numpy as np
from pool import gather
from row import Row

from helpers.attended import stroke, touch

ROBOTS = (
    "nao", "nao-h21", "nao-hands", "nao-whole", "nao-plain", "icub", "icub-hands", "icub-whole", "talos",
    "alex", "g1", "g1-hands", "g1-inspire",
)  # fmt: skip
NECKS = "nao", "icub", "talos", "alex"
FULL, SMALL = 60, 4
"""Touches of each robot."""
KINDS = (
    "stroke 'left forearm' 0.2..0.8 3N 3cm/s",
    "stroke 'left forearm' 0.1..0.9 2N 8cm/s",
    "rub 'left forearm' 3N",
)


def attends(full: bool) -> Row:
    """Every touch counts for which the finger has room. Where joints can't look at the place, the gaze must
    come as near as they go. Where the robot tells why it stays away, the trial is met and counted apart."""
    jobs = [(name, 1000 + seed, "") for seed in range(FULL if full else SMALL) for name in ROBOTS]
    jobs += [(name, 0, kind) for name in NECKS for kind in KINDS[: 3 if full else 1]]
    done = [one for one in gather("attends", _one, jobs, full=full) if one["counts"]]
    touches, strokes = ([one for one in done if one["stroke"] is stroked] for stroked in (False, True))
    missed = [one for one in done if not one["met"]]
    print(*missed, sep="\n")
    reached = [one for one in touches if one["best"] < 4.0]
    off = (
        np.percentile([one["off"] for one in reached if not one["kept"]], [50, 100])
        if reached
        else [np.nan] * 2
    )
    return Row(
        "gaze at a touch after the withdrawal, and at a stroke, judged by MuJoCo and the makers' cameras",
        len(done),
        len(ROBOTS) * FULL + len(NECKS) * len(KINDS),
        "touches",
        f"{len(missed)} missed; {len(reached)} of {len(touches)} places within reach, {off[0]:.1f} degrees "
        f"off (median), {off[1]:.1f} (worst); {len(strokes)} strokes followed within "
        f"{max((one['off'] for one in strokes), default=0.0):.1f} degrees; "
        f"told: {sum(one['kept'] == 'a collision' for one in touches)} stopped before a collision, "
        f"{sum(one['kept'] == 'the finger' for one in touches)} not turned back to the finger (G1), "
        f"{sum(one['kept'] == 'the arm' for one in touches)} late, since the arm met its own body",
        "within 5 degrees, or as near as the joints go, 0.3 s (a waist: 0.7 s) + angle / (0.8 x speed) after "
        "the withdrawal; a stroke within 10 degrees",
        not missed,
    )


def _one(name: str, seed: int, kind: str) -> dict[str, Any]:
    about: dict[str, Any] = {"robot": name, "seed": seed, "stroke": bool(kind), "counts": False, "kept": ""}
    if kind:
        before = {"left_arm": np.deg2rad([60, 10, 30, 80, 0])}
        followed = stroke(name, kind, posture=before)
        if followed is None:
            return about
        return {**about, "counts": True, "off": followed.worst, "met": followed.worst <= 10.0, "kind": kind}
    seen = touch(name, seed)
    if seen is None:
        return about
    return {
        **about, "counts": True, "patch": seen.patch, "best": seen.best, "off": seen.off, "late": seen.late,
        "turned": seen.turned, "kept": seen.kept, "met": seen.met,
    }  # fmt: skip
