"""Figure of docs/conventions.md: the joints of the generic arm, and the coordinates of places on a limb."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tci.messages.frames import Array
from tci.robot.generic_arm import JOINTS, Side, forearm_rotation, side_sign, upper_arm_rotation

UPPER, LOWER, HAND = 0.28, 0.25, 0.09
"""Lengths [m] of upper arm, forearm and thumb of the drawn arm."""
SHOULDER = 0.2
"""Distance [m] of each shoulder from the middle of the drawn trunk."""
HEIGHT = 0.92
"""Height [m] of each panel."""
PALE, DARK, ACCENT = "#b9c4cf", "#1d2733", "#c8452f"
THUMBS = {PALE: "#6f7d8a", ACCENT: ACCENT}
SIDES: tuple[Side, Side] = ("left", "right")
TURN = np.deg2rad(40.0)
BENT = np.deg2rad(90.0)
VIEWS = {"from the right": (0, 2), "from the front": (1, 2), "from above": (1, 0)}
"""For each view: the axes of the torso frame that are drawn along the width and the height. Seen from above,
y points left."""
SHOWN = ("from the right", "from the front", "from above", "from the right", "from the front")
"""For each joint: the view that shows its motion best."""
WORDS = ("flexion", "abduction", "internal rotation", "elbow flexion", "pronation")


def arm(posture: Array, side: Side) -> tuple[Array, Array]:
    """Returns shoulder, elbow and wrist (3, 3), and the line of the thumb (2, 3), in the torso frame [m]."""
    s = side_sign(side)
    shoulder = np.array([0.0, s * SHOULDER, 0.0])
    elbow = shoulder - UPPER * upper_arm_rotation(posture, side, axial=True)[:, 2]
    forearm = forearm_rotation(posture, side, axial=True)
    wrist = elbow - LOWER * forearm[:, 2]
    return np.array([shoulder, elbow, wrist]), np.array([wrist, wrist + HAND * forearm[:, 0]])


def draw_arm(axes: Axes, posture: Array, view: str, colour: str) -> None:
    """Draws both arms at one generic posture. The view from the right shows only the right arm. Thumbs are
    drawn on top."""
    wide, high = VIEWS[view]
    for side in SIDES[view == "from the right" :]:
        bones, thumb = arm(posture, side)
        axes.plot(bones[:, wide], bones[:, high], color=colour, linewidth=5.0, solid_capstyle="round")
        axes.plot(thumb[:, wide], thumb[:, high], color=THUMBS[colour], linewidth=2.5, zorder=3)


def draw_trunk(axes: Axes, view: str) -> None:
    """Draws trunk and head."""
    if view == "from above":
        axes.add_patch(plt.Rectangle((-0.15, -0.09), 0.3, 0.18, color="#eef2f5"))
        axes.add_patch(plt.Circle((0.0, 0.0), 0.09, color="#dde4ea"))
        return
    half = 0.09 if view == "from the right" else 0.15
    axes.add_patch(plt.Rectangle((-half, -0.5), 2 * half, 0.55, color="#eef2f5"))
    axes.add_patch(plt.Circle((0.0, 0.17), 0.09, color="#dde4ea"))


def draw_joint(axes: Axes, joint: int) -> None:
    """Draws the arms before (pale) and after a rotation of one joint by 40 degrees."""
    view = SHOWN[joint]
    before = np.zeros(5)
    if joint in (2, 4):
        before[3] = BENT  # otherwise the rotation is not visible
    after = before.copy()
    after[joint] += TURN
    draw_trunk(axes, view)
    draw_arm(axes, before, view, PALE)
    draw_arm(axes, after, view, ACCENT)
    axes.set_title(f"{joint}  {JOINTS[joint]} +40°\n{WORDS[joint]}, {view}", fontsize=9)
    low, ends = (-0.4, (0.62, -0.62)) if view == "from above" else (-0.62, (-0.62, 0.62))
    axes.set(xlim=ends, ylim=(low, low + HEIGHT), aspect="equal")


def draw_theta(axes: Axes) -> None:
    """Draws cross sections of both hanging forearms as seen from above, with values of theta around them."""
    for side, centre in zip(SIDES, (0.3, -0.3), strict=True):
        s = side_sign(side)
        axes.add_patch(plt.Circle((centre, 0.0), 0.13, facecolor="#eef2f5", edgecolor=DARK))
        for degrees in (0, 90, 180, -90):
            theta = np.deg2rad(degrees)
            x, y = np.cos(theta), s * np.sin(theta)  # forward; left
            axes.plot([centre, centre + 0.13 * y], [0.0, 0.13 * x], color=ACCENT, linewidth=1.0)
            axes.text(centre + 0.19 * y, 0.19 * x, f"{degrees}°", ha="center", va="center", fontsize=8)
        axes.text(centre, -0.33, f"{side} limb", ha="center", fontsize=8)
    axes.text(0.0, 0.34, "front", ha="center", fontsize=8, color="#5b6875")
    axes.set(xlim=(0.62, -0.62), ylim=(-0.5, -0.5 + HEIGHT), aspect="equal")
    axes.set_title("theta, around a hanging limb\nfrom above", fontsize=9)


def draw(path: Path) -> None:
    """Draws the five joints and the angle theta."""
    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    for joint, axes in enumerate(panels[:5]):
        draw_joint(axes, joint)
    draw_theta(panels[5])
    for axes in panels:
        axes.set(xticks=(), yticks=())
        axes.spines[:].set_color("#dde4ea")
    figure.savefig(path, dpi=110)
