"""Picture of touch words: how often each touch of the judge's people is told as each word."""

from __future__ import annotations

import os
import sys
from collections import Counter
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from helpers.worded import OTHERS, WORDS, Outcome, judge, macro_f1

ROBOTS = "g1", "icub"
EACH = int(os.environ.get("EACH", "8"))
"""Touches for each word and robot; as many mean nothing."""


def judged(name: str) -> list[Outcome]:
    per = -(-EACH * len(WORDS) // len(OTHERS))
    done = [judge(name, word, 7000 + k) for word in WORDS for k in range(EACH)]
    return done + [judge(name, other, 7000 + k) for other in OTHERS for k in range(per)]


def draw(path: Path) -> None:
    names = [*WORDS, "other"]
    figure, panels = plt.subplots(1, len(ROBOTS), figsize=(9.5, 4.6), layout="constrained", sharey=True)
    for panel, robot in zip(panels, ROBOTS, strict=True):
        done = judged(robot)
        score, each = macro_f1(done)
        counts = Counter((one.true, one.word) for one in done)
        table = np.array([[counts[true, word] for word in (*names, "nothing")] for true in names], float)
        table /= table.sum(axis=1, keepdims=True)
        panel.imshow(table, cmap="Blues", vmin=0.0, vmax=1.0)
        for row, column in zip(*np.nonzero(table > 0.005), strict=True):
            dark = table[row, column] > 0.6
            panel.text(column, row, f"{100 * table[row, column]:.0f}", ha="center", va="center", fontsize=6.5,
                       color="white" if dark else "black")  # fmt: skip
        panel.set_xticks(range(len(names) + 1), [*names, "nothing"], rotation=90, fontsize=8)
        panel.set_yticks(range(len(names)), names, fontsize=8)
        panel.set_title(f"{robot}: macro F1 {score:.2f} of {len(done)} touches", fontsize=9)
        panel.set_xlabel("told as [%]", fontsize=8)
        print(robot, f"{score:.3f}", {word: round(one, 2) for word, one in each.items()})
    panels[0].set_ylabel("what was done", fontsize=8)
    figure.savefig(path, dpi=100)
    Image.open(path).convert("RGB").quantize(48).save(path, optimize=True)
    plt.close(figure)
