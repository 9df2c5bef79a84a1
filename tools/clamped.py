"""Draws the force on somebody who can't give way before a moving arm, without and with the gate's answer."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
from scipy.signal import medfilt

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

import tci
from helpers.squeezed import Outcome, squeeze
from helpers.squeezes import draw
from tci.gate import ContactSettings, GateSettings

TRIAL = "icub", 1
"""Robot and seed: a hand at full speed, 75 N/mm."""
LIMIT = 65.0
"""The least quasi-static limit [N] of ISO/TS 15066."""


def run() -> tuple[Outcome, Outcome]:
    """The trial without and with the answer."""
    robot = tci.load_robot(TRIAL[0])
    trial = draw(robot, TRIAL[1])
    settings = GateSettings(contact=None), GateSettings(contact=ContactSettings())
    before, after = (squeeze(robot, trial, settings=one) for one in settings)
    return before, after


def picture(file: Path) -> None:
    """Writes the picture."""
    before, after = run()
    figure, axes = plt.subplots(figsize=(7.0, 3.0), layout="constrained")
    for one, colour, words in (
        (before, "tab:red", "without the gate's answer"),
        (after, "tab:green", "with it: the arm goes back"),
    ):
        assert one.first is not None
        times, forces = one.force
        axes.plot(times - one.first, medfilt(forces, 21), color=colour, label=words)
    axes.axhline(LIMIT, color="grey", linestyle="--", linewidth=1.0)
    axes.annotate("65 N, least limit of ISO/TS 15066", (2.2, LIMIT), va="bottom", ha="right", color="grey")
    axes.set(
        xlim=(-0.2, 2.2),
        ylim=(0.0, None),
        xlabel="time since the contact [s]",
        ylabel="force, median of 10 ms [N]",
    )
    axes.legend(loc="upper right", frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)
