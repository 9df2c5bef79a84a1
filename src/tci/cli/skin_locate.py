"""`tci skin locate`: estimates the positions of taxels from touches at known places."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName


def locate(
    robot: RobotName,
    patch: Annotated[str, typer.Option(help="Patch of skin to locate.")],
    touches: Annotated[
        Path | None,
        typer.Option(
            help="Touches (.csv). Each row has x y z \\[m] and nx ny nz in the frame of the patch's link, "
            "then the raw values."
        ),
    ] = None,
    count: Annotated[int, typer.Option(min=3, max=100000, help="Number of simulated touches.")] = 200,
    wrong: Annotated[
        float, typer.Option(min=0.0, max=0.1, help="Error \\[m] of the initial positions in the simulation.")
    ] = 0.010,
    out: Annotated[Path | None, typer.Option(help="Table of the positions to write (.csv).")] = None,
    as_json: AsJson = False,
) -> None:
    """Find the positions of taxels from touches at known places (spatial self-calibration).

    Without --touches, TCI tests the method in simulation. A simulated probe touches a skin with wrong
    positions, and TCI prints the error that remains after the correction.

    Example:  tci skin locate nao --patch left_forearm
    """
    import numpy as np
    from rich.progress import Progress

    from tci.lab.authoring.locate_taxels import locate_taxels
    from tci.lab.authoring.touch_files import read_touches, write_taxels
    from tci.lab.experiments.self_calibration import calibrate_in_simulation
    from tci.robot.catalogue import load_robot
    from tci.robot.kinematics import KinematicChain
    from tci.skin.surfaces import build_surface

    words = load_robot(robot)
    surface = build_surface(words, words.patch(patch), KinematicChain(words))
    if touches is not None:
        located = locate_taxels(read_touches(touches, words, surface), surface.positions)
        moved = np.linalg.norm(located.positions - surface.positions, axis=1)
        report = {"patch": patch, "median_moved_mm": 1e3 * float(np.median(moved))}
        line = f"{patch}: taxels moved by {report['median_moved_mm']:.1f} mm (median)"
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
        report = {"patch": patch, "touches": count, "before_mm": before, "after_mm": after,
                "p95_after_mm": 1e3 * float(np.quantile(done.after, 0.95))}  # fmt: skip
        line = f"{patch}: median error of the taxels' positions {before:.1f} mm before, {after:.1f} mm after"
    never = int((located.touches == 0).sum())
    if out is not None:
        write_taxels(out, surface, located)
    if as_json:
        print_json({**report, "never_touched": never, "width_mm": 1e3 * located.width})
        return
    console.print(f"{line}; {never} of {len(located.touches)} taxels were never touched", highlight=False)
    if out is not None:
        console.print(
            f'table {out}; use it in a description: <table file="{out.name}" format="csv"/>',
            highlight=False, markup=False,
        )  # fmt: skip
