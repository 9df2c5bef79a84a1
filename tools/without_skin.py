"""Picture of docs/touch-without-skin.md: pushes on an arm whose surface is unrolled, and the estimates of
their places."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from helpers.bare_body import FOREARM, UPPER_ARM, bare_body
from helpers.push_trials import NEWTON, pushed
from tci.messages.frames import Array

PUSHES = 24


def draw(path: Path) -> None:
    """Draws `PUSHES` pushes on each segment: a cross at the true place, a disc at the estimated place."""
    figure, axes = plt.subplots(1, 2, figsize=(10.0, 4.2), layout="constrained")
    for axis, patch in zip(axes, (UPPER_ARM, FOREARM), strict=True):
        positions = bare_body().skin.surfaces[patch].positions
        felt = [pushed(patch, seed) for seed in range(PUSHES)]
        right = [one for one in felt if one.right]
        away = [one for one in felt if not one.right]
        axis.plot(*_unrolled(positions, positions), ".", color="0.85", ms=3)
        for one in right:
            assert one.contact is not None
            ends = np.array([one.push.point, one.contact.p_L])
            axis.plot(*_unrolled(ends, positions), color="0.5", lw=1)
        if right:
            places = _unrolled(np.array([one.contact.p_L for one in right if one.contact]), positions)
            shown = axis.scatter(*places, c=[one.certainty for one in right], vmin=0, vmax=1, s=60, zorder=3)
        axis.plot(*_unrolled(np.array([one.push.point for one in right]), positions), "kx", ms=6, zorder=4)
        axis.plot(*_unrolled(np.array([one.push.point for one in away]), positions), "rx", ms=6, zorder=4)
        median = float(np.median([one.error for one in felt])) * 100.0
        words = f"median {median:.1f} cm off" if np.isfinite(median) else "most not felt, or elsewhere"
        name = patch.removeprefix("left_").replace("_", " ")
        axis.set_title(f"{name}: {len(right)} of {PUSHES} felt on it, {words}", fontsize=10)
        axis.set_xlabel("along the axis [mm]")
        axis.set_ylabel("around it [mm]")
        axis.set_aspect("equal")
    figure.colorbar(shown, ax=axes, label="certainty")
    figure.suptitle(
        f"{NEWTON:.0f} N on a moving arm, 10 % wrong masses, half of the friction unknown: "
        "cross = pushed (red: not felt there), disc = felt",
        fontsize=10,
    )
    figure.savefig(path, dpi=110)


def _unrolled(points: Array, surface: Array) -> tuple[Array, Array]:
    """Returns positions (n,) [mm] along the axis and around the axis of a limb's `surface`, for points in the
    frame of its link."""
    centre = surface.mean(axis=0)
    _, _, (along, one, other) = np.linalg.svd(surface - centre, full_matrices=False)
    radius = float(np.hypot((surface - centre) @ one, (surface - centre) @ other).mean())
    apart = points - centre
    return 1e3 * apart @ along, 1e3 * radius * np.arctan2(apart @ one, apart @ other)
