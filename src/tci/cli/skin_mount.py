"""`tci skin mount`: computes the pose of a skin on a link from touches by another skin of the robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName


def mount(
    robot: RobotName,
    patch: Annotated[str, typer.Option(help="Patch of skin with an uncertain pose on its link.")],
    touches: Annotated[
        Path | None,
        typer.Option(help="Recording (.mcap) in which the robot touches this patch with another patch."),
    ] = None,
    count: Annotated[int, typer.Option(min=10, max=10000, help="Number of simulated touches.")] = 100,
    wrong: Annotated[
        float, typer.Option(min=0.0, max=0.05, help="Error \\[m] of the mounted position in the simulation.")
    ] = 0.010,
    turned: Annotated[
        float,
        typer.Option(min=0.0, max=30.0, help="Error \\[deg] of the mounted orientation in the simulation."),
    ] = 5.0,
    out: Annotated[
        Path | None,
        typer.Option(help="Description (.xml) to write beside the description that this file extends."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find the pose of a skin on its link from self-touch: another skin of the robot touches this skin. TCI
    uses only the indices of the pressed taxels, not the pressures.

    Without --touches, TCI tests the method in simulation. A simulated robot with a wrongly mounted skin
    touches this skin, and TCI prints the error that remains after the correction.

    Example:  tci skin mount nao --patch left_forearm

    Example:  tci skin mount my_icub.xml --patch left_forearm --touches self-touch.mcap --out mended.xml
    """
    import numpy as np
    from rich.progress import Progress

    from tci.errors import CommandError
    from tci.lab.authoring.mount_skin import mount_in_recording, write_mounted
    from tci.lab.experiments.self_touch import mount_in_simulation
    from tci.robot.catalogue import load_robot

    words = load_robot(robot)
    if touches is None:
        if out is not None:
            raise CommandError("--out without --touches; valid: a recording of the robot itself")
        with Progress(console=console, disable=as_json or not console.is_terminal, transient=True) as bar:
            task = bar.add_task("touching", total=count)
            done = mount_in_simulation(
                words, patch, touches=count, wrong=wrong, turned=np.deg2rad(turned),
                progress=lambda made: bar.update(task, completed=made),
            )  # fmt: skip
        found = done.mount
        simulated = {"before_mm": 1e3 * done.before, "after_mm": 1e3 * done.after}
    else:
        found, simulated = mount_in_recording(touches, words, patch), {}
        if out is not None:
            write_mounted(words, patch, found, out)
    if as_json:
        print_json({"patch": patch, **found.facts(), **simulated})
        return
    facts = found.facts()
    console.print(
        f"{patch}: {found.touches} touches, {found.left_out} left out; they meet within "
        f"{facts['residual_mm']:.1f} mm (root mean square), {facts['apart_mm']:.1f} mm before",
        highlight=False,
    )
    x, y, z = facts["xyz_m"]
    roll, pitch, yaw = facts["rpy_deg"]
    console.print(
        f"correction in {words.patch(patch).link}: {facts['moved_mm']:.1f} mm where it was touched, "
        f'{facts["turned_deg"]:.1f} degrees (xyz="{x:.5f} {y:.5f} {z:.5f}" '
        f'rpy="{roll:.3f} {pitch:.3f} {yaw:.3f}")',
        highlight=False, markup=False,
    )  # fmt: skip
    if simulated:
        console.print(
            f"taxels were {simulated['before_mm']:.1f} mm off, now {simulated['after_mm']:.1f} mm (median)",
            highlight=False,
        )
    if out is not None:
        console.print(f"description {out}", highlight=False, markup=False)
