"""Picture of each kind of touch: where it presses on an unrolled forearm, and its force over time."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from PIL import Image

from tci.body import GenericBody
from tci.lab.pictures.paint import PRESSURE_COLOURS
from tci.touches import KINDS, LaidTouches, plan
from tci.touches.places import initial_joints

ROBOT, PLACE = "g1", "left forearm outside"
COLUMNS = 6


def draw(path: Path) -> None:
    body = GenericBody(ROBOT)
    kinds = [kind for kind in KINDS.values() if kind.generator != "none"]
    colours = LinearSegmentedColormap.from_list("pressure", PRESSURE_COLOURS)
    figure, panels = plt.subplots(6, COLUMNS, figsize=(9.5, 8.0), layout="constrained",
                                  height_ratios=[2.2, 1.0] * 3)  # fmt: skip
    for number, kind in enumerate(kinds):
        row, column = divmod(number, COLUMNS)
        skin, force = panels[2 * row, column], panels[2 * row + 1, column]
        (planned,) = plan(body, f"{kind.name} '{PLACE}'")
        u, theta, _ = body.skin.limb(planned.patch, initial_joints(body))
        peak = LaidTouches(body, [planned]).pressure(planned.times)[planned.patch].max(axis=0)
        angle = np.rad2deg(np.mod(theta + np.pi / 2.0, 2.0 * np.pi)) - 90.0
        skin.scatter(u, angle, c=peak / 1e3, s=7.0, cmap=colours, vmin=0.0)
        skin.set_title(kind.name, fontsize=9)
        skin.set(xticks=[], yticks=[])
        force.plot(planned.times - planned.onset, planned.force.sum(axis=1), color="#b5483f", linewidth=1.0)
        force.set_ylim(0.0, 1.3 * planned.peak)
        force.tick_params(labelsize=6)
        force.text(
            0.98, 0.95, f"{planned.peak:.2g} N", transform=force.transAxes, ha="right", va="top", fontsize=7
        )
    figure.supxlabel("time [s]", fontsize=8)
    figure.savefig(path, dpi=100)
    Image.open(path).convert("RGB").quantize(48).save(path, optimize=True)
    plt.close(figure)
