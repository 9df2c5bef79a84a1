"""Figure of docs/motion.md: the set-points that the gate sends to one joint, recorded from a simulated
NAO."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import tci
from tci.messages import PlatformCommand, PlatformSwitch
from tci.messages.frames import Array

ROBOT, SERVO = "nao", "LShoulderPitch"
DARK, ACCENT, PALE = "#1d2733", "#c8452f", "#9aa7b4"
DURATION = 0.9
CASES = {
    "position: a new target on the way": (tci.Mode.POSITION, {0.1: 20.0, 0.3: 90.0}),
    "velocity: up to the limit": (tci.Mode.VELOCITY, {0.1: 150.0}),
    "HOLD: joint data stays away": (tci.Mode.POSITION, {0.1: -30.0}),
}
"""For each column: the control mode, and the commands [degrees, degrees/s] by the time [s] at which they are
sent. A command is repeated until the time of the next command."""
SILENT = 0.25
"""Time [s] after which the last case repeats an old reading."""


def run(case: str) -> tuple[Array, Array]:
    """Returns time and sent angle (n, 2) [s, rad], and the joint's limits of angle, speed and
    acceleration."""
    mode, targets = CASES[case]
    with tci.connect(ROBOT, "sim") as driver:
        servo = next(servo for servo in driver.robot.servos if servo.name == SERVO)
        here, limits = np.array([servo.index]), servo.limits
        joints, rows = driver.read().joints, []
        for now in driver.ticks(duration=DURATION):
            reading = driver.read().joints
            joints = joints if "HOLD" in case and now >= SILENT else reading
            orders: list[PlatformCommand | PlatformSwitch] = []
            value = next((targets[time] for time in sorted(targets, reverse=True) if now >= time), None)
            if now == 0.0 and mode is not tci.Mode.POSITION:
                orders.append(PlatformSwitch(here, mode))
            elif value is not None:
                values, speed = np.deg2rad([value]), np.array([limits.velocity])
                orders.append(PlatformCommand(mode, here, values, speed))
            safe = driver.gate.step(orders, joints, now)
            driver.write(safe)
            angle = safe.position[0] if len(safe.position) else reading.position[servo.index]
            rows.append((now, angle))
        bounds = (limits.lower, limits.upper, limits.velocity, limits.acceleration)
        return np.array(rows), np.array(bounds)


def draw(path: Path) -> None:
    """Draws angle, speed and acceleration of each case, with the limits."""
    figure = Figure(figsize=(9.0, 5.2), layout="constrained")
    panels = figure.subplots(3, len(CASES), sharex=True, sharey="row")
    for column, case in enumerate(CASES):
        rows, (lower, upper, fastest, steepest) = run(case)
        time, angle = rows[:, 0], np.rad2deg(rows[:, 1])
        speed = np.gradient(angle, time)
        series = (angle, speed, np.gradient(speed, time) / 1e3)
        bounds = ((lower, upper), (-fastest, fastest), (-steepest / 1e3, steepest / 1e3))
        for axes, values, limits in zip(panels[:, column], series, bounds, strict=True):
            axes.plot(time, values, color=DARK)
            for limit in np.rad2deg(limits):
                axes.axhline(limit, color=PALE, linestyle="--", linewidth=0.8)
        for at in (*CASES[case][1], *((SILENT,) if "HOLD" in case else ())):
            for axes in panels[:, column]:
                axes.axvline(at, color=ACCENT, linewidth=0.8)
        panels[0, column].set_title(case, fontsize=10)
        panels[-1, column].set_xlabel("time [s]")
    for axes, label in zip(
        panels[:, 0], ("angle [°]", "speed [°/s]", "acceleration\n[1000 °/s²]"), strict=True
    ):
        axes.set_ylabel(label)
    figure.savefig(path, dpi=100)
