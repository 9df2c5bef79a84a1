"""Estimates touches without skin, on a simulated robot with wrong masses, noise, and half of its friction
unknown."""

from __future__ import annotations

import numpy as np
from pool import Job, Result, gather
from row import Row

from helpers.bare_body import FOREARM
from helpers.push_trials import NEWTON, pushed, untouched, withdrawn

BATCH = 10
"""Number of pushes in one job."""
STRETCH = 120.0
"""Time [s] of motion in one job."""


def felt_places(full: bool) -> Row:
    """Pushes a moving forearm, and checks the estimates of place, segment and force."""
    done = gather("felt_places", _pushes, _jobs(20 if full else 2), full=full)
    columns = ("error", "right", "force")
    error, right, force = (np.concatenate([one[c] for one in done] or [[]]) for c in columns)
    tried = len(error)
    place, share, wrong = np.median(error), np.mean(right), np.median(force)
    return Row(
        f"pushes of {NEWTON:.0f} N on a forearm without skin",
        tried,
        200,
        "pushes",
        f"median error of the place {place * 100:.1f} cm; segment right for {share:.0%} of the pushes; "
        f"median error of the force {wrong:.0%}; error of the force at most 25 % for "
        f"{np.mean(force <= 0.25):.0%} of the pushes",
        "median errors at most 5 cm and 25 %, segment right for 85 %",
        bool(tried and place <= 0.05 and share >= 0.85 and wrong <= 0.25),
    )


def felt_nothing(full: bool) -> Row:
    """Moves the robot without any touch, and checks that no contact is reported."""
    done = gather("felt_nothing", _motion, [(seed,) for seed in range(90 if full else 4)], full=full)
    hours, false = len(done) * STRETCH / 3600.0, sum(one["false"] for one in done)
    slowest = max((one["step"] for one in done), default=0.0)
    return Row(
        "motion of a robot without skin that is not touched",
        round(hours, 3),
        3,
        "hours",
        f"{false} false contacts; 99 % of the perceptions computed within {slowest * 1e3:.2f} ms",
        "less than 1 false contact per hour, 99 % within 2 ms",
        bool(done) and false < max(1.0, hours) and slowest < 2e-3,
    )


def felt_reflex(full: bool) -> Row:
    """Checks the withdrawal reflex for pushes on a forearm without skin."""
    done = gather("felt_reflex", _reflexes, _jobs(10 if full else 2), full=full)
    answered, away = (sum(one[key] for one in done) for key in ("answered", "away"))
    tried = BATCH * len(done)
    return Row(
        "withdrawal reflex of a robot without skin",
        tried,
        100,
        "pushes",
        f"{answered} pushes answered; in {away} of them the arm moved away from the push",
        "in 9 of 10 pushes the arm moves away from the push",
        bool(tried) and away >= 0.9 * tried,
    )


def _jobs(count: int) -> list[Job]:
    return [(BATCH * number,) for number in range(count)]


def _pushes(first: int) -> Result:
    felt = [pushed(FOREARM, seed) for seed in range(first, first + BATCH)]
    return {
        "error": [one.error for one in felt],
        "right": [one.right for one in felt],
        "force": [one.force_error for one in felt],
    }


def _motion(seed: int) -> Result:
    false, step = untouched(seed, STRETCH)
    return {"false": false, "step": step}


def _reflexes(first: int) -> Result:
    found = [withdrawn(FOREARM, seed) for seed in range(first, first + BATCH)]
    return {"answered": sum(one for one, _ in found), "away": sum(a and b for a, b in found)}
