"""Picture of the reflex's commands over the unrolled skin of two arms, by three responses."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tci
from tci.testing import TouchedRobot

ROBOTS = ("nao", "icub")
RESPONSES = {"printed": "eqs 5-6 as printed", "meant": "eqs 5-6 as meant", "blended": "blended (default)"}
FORCE = 5.0
"""Force [N] of the touches: full response."""


def draw(path: Path) -> None:
    """Writes the picture: a row per robot and segment, a column per response. A dot is a taxel of the left
    arm, coloured by the largest angle of the command to a touch there, hollow without a command."""
    figure, panels = plt.subplots(4, 3, figsize=(9.5, 7.0), sharex=True, sharey=True, layout="constrained")
    for row, (name, segment) in enumerate((n, s) for n in ROBOTS for s in ("forearm", "upper_arm")):
        touched = TouchedRobot(name)
        for panel, (response, title) in zip(panels[row], RESPONSES.items(), strict=True):
            reflex = tci.WithdrawalReflex(response=response)  # type: ignore[arg-type]
            dots = []
            for taxel in range(len(touched.body.skin.surfaces[f"left_{segment}"].positions)):
                seen = touched.perceive(f"left_{segment}", taxel=taxel, force=FORCE)
                orders, _ = reflex.step(reflex.init(touched.body), seen, touched.body)
                size = 0.0
                for order in orders:
                    if isinstance(order, tci.GenericCommand) and order.part == "left_arm":
                        size = float(np.rad2deg(np.abs(order.values - seen.posture[order.part]).max()))
                touch = seen.contacts[0]
                dots.append((np.rad2deg(touch.theta), touch.u, size))
            theta, u, sizes = np.array(dots).T
            none = sizes == 0.0
            panel.scatter(theta[none], u[none], s=9, facecolors="none", edgecolors="0.7", linewidths=0.6)
            shown = panel.scatter(
                theta[~none], u[~none], c=sizes[~none], s=14, vmin=0, vmax=25, cmap="viridis"
            )
            if row == 0:
                panel.set_title(title, fontsize=10)
            panel.set_xticks([-180, -90, 0, 90, 180])
        panels[row, 0].set_ylabel(f"{name}, {segment.replace('_', ' ')}\nu", fontsize=9)
    figure.supxlabel("theta [degrees]: 0 flexor side, 90 lateral, 180 extensor, -90 medial", fontsize=9)
    figure.colorbar(shown, ax=panels, label="largest angle of the command [degrees]", shrink=0.6)
    figure.savefig(path, dpi=110)
