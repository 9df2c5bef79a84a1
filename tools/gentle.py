"""Draws what a gentle arm presses with when it meets partners of three stiffnesses."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from helpers.gentled import meet

TRIAL, CAP = ("g1", 3), 10.0
PARTNERS = (
    (10e3, "abdomen, 10 N/mm", "tab:green"),
    (25e3, "chest, 25 N/mm", "tab:blue"),
    (75e3, "hand, 75 N/mm", "tab:red"),
)


def picture(file: Path) -> None:
    """Writes the picture."""
    figure, axes = plt.subplots(figsize=(7.0, 3.0), layout="constrained")
    for stiffness, words, colour in PARTNERS:
        met = meet(*TRIAL, cap=CAP, stiffness=stiffness)
        assert met is not None
        axes.plot(*met.force, color=colour, label=words, linewidth=1.2)
    axes.axhline(CAP, color="grey", linestyle="--", linewidth=1.0)
    axes.annotate("cap", (2.4, CAP), va="bottom", ha="right", color="grey")
    axes.set(xlim=(-0.05, 2.4), ylim=(0.0, None), xlabel="time since the contact [s]", ylabel="force [N]")
    axes.legend(loc="upper right", frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)
