"""Draws the force of a hand that guides a Talos' arm, and what the arm repeats."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from helpers.taught import guide

TRIAL = "talos", 1
JOINTS = "shoulder pitch", "shoulder roll", "shoulder yaw", "elbow"


def picture(file: Path) -> None:
    """Writes the picture."""
    seen = guide(*TRIAL)
    assert seen is not None
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 3.0), layout="constrained")
    left.plot(*seen.force, color="tab:blue", linewidth=1.2)
    for force, words in ((5.0, "median at most"), (8.0, "95 % at most")):
        left.axhline(force, color="grey", linestyle="--", linewidth=1.0)
        left.annotate(words, (1.1, force), va="bottom", ha="right", color="grey", fontsize=8)
    left.set(
        xlim=(-0.05, 1.12),
        ylim=(0.0, 10.0),
        xlabel="time since the contact [s]",
        ylabel="force of the hand [N]",
    )
    for joint, words in enumerate(JOINTS):
        (line,) = right.plot(
            seen.taught[0], np.degrees(seen.taught[1][:, joint]), label=words, linewidth=3.0, alpha=0.35
        )
        right.plot(
            seen.repeated[0], np.degrees(seen.repeated[1][:, joint]), color=line.get_color(), linewidth=1.2
        )
    right.set(xlabel="time [s]", ylabel="angle [degrees]", title="broad: guided, thin: repeated")
    right.legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)
