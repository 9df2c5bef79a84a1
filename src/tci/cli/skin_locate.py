"""`tci skin locate`: estimates the positions of taxels from touches at known places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.progress import Progress

from tci.authoring.locate_taxels import LocatedTaxels, ProbeTouch, locate_taxels
from tci.cli.console import console, print_json
from tci.errors import CommandError
from tci.experiments.self_calibration import calibrate_in_simulation
from tci.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface, build_surface

PLACE = 6
"""Number of columns before the raw values of a touch: x y z [m] and the outward normal."""


def locate(
    robot: str, patch: str, *, touches: Path | None, count: int, wrong: float, out: Path | None, as_json: bool
) -> None:
    """Locates the taxels of a patch from a file of touches, or in simulation, and prints the result.

    In simulation the true positions are known, so the error is printed. Options as in `tci skin`. Raises
    CommandError for a file that does not fit the patch, and what `calibrate_in_simulation` raises.
    """
    words = load_robot(robot)
    surface = build_surface(words, words.patch(patch), KinematicChain(words))
    if touches is not None:
        located = locate_taxels(_read(touches, words, surface), surface.positions)
        moved = np.linalg.norm(located.positions - surface.positions, axis=1)
        told = {"patch": patch, "median_moved_mm": 1e3 * float(np.median(moved))}
        line = f"{patch}: taxels moved by {told['median_moved_mm']:.1f} mm (median)"
    else:
        with Progress(console=console, disable=as_json, transient=True) as progress:
            task = progress.add_task("touching", total=count)
            done = calibrate_in_simulation(
                words,
                patch,
                touches=count,
                wrong=wrong,
                progress=lambda done: progress.update(task, completed=done),
            )
        located = done.located
        before, after = (1e3 * float(np.median(errors)) for errors in (done.before, done.after))
        told = {"patch": patch, "touches": count, "before_mm": before, "after_mm": after,
                "p95_after_mm": 1e3 * float(np.quantile(done.after, 0.95))}  # fmt: skip
        line = f"{patch}: median error of the taxels' positions {before:.1f} mm before, {after:.1f} mm after"
    never = int((located.touches == 0).sum())
    if out is not None:
        _write(out, surface, located)
    if as_json:
        print_json({**told, "never_touched": never, "width_mm": 1e3 * located.width})
        return
    console.print(f"{line}; {never} of {len(located.touches)} taxels were never touched", highlight=False)
    if out is not None:
        console.print(
            f'table {out}; use it in a description: <table file="{out.name}" format="csv"/>',
            highlight=False, markup=False,
        )  # fmt: skip


def _read(path: Path, robot: Robot, surface: Surface) -> list[ProbeTouch]:
    """Reads touches from a CSV file: x, y, z [m], nx, ny, nz in the patch's link, then the raw frame."""
    patch = robot.patch(surface.patch)
    try:
        rows = np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError as error:
        raise CommandError(f"{path}: {error}; valid: rows of numbers separated by commas") from error
    if rows.shape[1] != PLACE + patch.channels:
        raise CommandError(
            f"{path}: {rows.shape[1]} numbers in a row; valid: {PLACE + patch.channels}, x y z nx ny nz "
            f"and the {patch.channels} channels of {patch.name}"
        )
    sensor = patch.sensor
    counts = (rows[:, PLACE:] - sensor.rest) * np.sign(sensor.pascal_per_count)
    pressure = sensor.pressure(np.maximum(counts[:, normal_channels(patch, surface)] - 1.0, 0.0))
    normals = rows[:, 3:PLACE] / np.maximum(np.linalg.norm(rows[:, 3:PLACE], axis=1, keepdims=True), 1e-9)
    return [ProbeTouch(p, n, a) for p, n, a in zip(rows[:, :3], normals, pressure, strict=True)]


def _write(path: Path, surface: Surface, located: LocatedTaxels) -> None:
    """Writes the taxels as a skin table. A taxel that was never touched keeps its previous normal."""
    lines = ["channel, x [mm], y [mm], z [mm], nx, ny, nz"]
    normals: Array = np.where(located.touches[:, None] > 0, located.normals, surface.normals)
    for channel, place, normal in zip(surface.channels, located.positions, normals, strict=True):
        numbers = [f"{1e3 * value:.3f}" for value in place] + [f"{value:.5f}" for value in normal]
        lines.append(", ".join([str(channel), *numbers]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
