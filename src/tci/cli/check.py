"""`tci check`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from tci.cli import completion
from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.experiments.proof import Proof
    from tci.robot.description import Robot


def check(
    robot: RobotName,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Prove it in simulation: axes, limits, reflexes.")
    ] = False,
    hardware: Annotated[
        bool, typer.Option("--hardware", help="Prove it on the robot itself, joint by joint, taxel by taxel.")
    ] = False,
    via: Annotated[
        str,
        typer.Option(
            help="With --hardware: driver that reaches it, NAME or NAME:ADDRESS.",
            autocompletion=completion.drivers,
        ),
    ] = "sim",
    only: Annotated[
        list[str] | None,
        typer.Option(help="With --hardware: a part, a joint or a patch; repeat for several."),
    ] = None,
    taxels: Annotated[int, typer.Option(min=-1, help="With --hardware: taxels of each patch; -1: all.")] = 12,
    as_json: AsJson = False,
) -> None:
    """Check a robot description: every fault at once, each with its line and what would be valid.

    With --simulate the axes of its arms are compared with the generic arm's, both arms are sent far outside
    their limits, every field of the withdrawal reflexes is poked, and every patch in its middle: what is
    touched must move away from the finger.

    With --hardware the robot itself is looked at; then each joint moves by 2 degrees, slowly, after you were
    asked, and you are asked what you saw; then you press its skin. Wrong signs, zeros, limits and units show.

    Exit status 0 when the file is valid and proved, 1 when it is not.

    Example:  tci check my-robot.xml --simulate

    Example:  tci check nao --hardware --via naoqi://10.0.0.5 --only left_arm
    """
    if hardware:
        from tci.cli.hardware import check_hardware

        check_hardware(robot, via=via, parts=only or [], taxels=taxels, as_json=as_json)
        return
    if via != "sim" or only or taxels != 12:
        raise CommandError("--via, --only and --taxels look at a robot itself; valid: with --hardware")
    from tci.robot.catalogue import load_robot

    found = load_robot(robot)
    notes = list(remarks(found))
    proof = _prove(found, quiet=as_json) if simulate else None
    if as_json:
        told = {} if proof is None else {"simulated": proof.to_json()}
        print_json({"robot": found.name, "valid": True, "remarks": notes, **told})
    else:
        _say(robot, found, notes)
        if proof is not None:
            _say_proof(proof)
    if proof is not None and proof.faults:
        raise SystemExit(1)


def _prove(robot: Robot, *, quiet: bool) -> Proof:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from tci.experiments.proof import prove

    columns = (TextColumn("{task.description:<32}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        task = progress.add_task("reading the model", total=14 + len(robot.patches))

        def tell(what: str) -> None:
            progress.update(task, advance=1, description=what)
            if not quiet and not console.is_terminal:  # there is no bar in a file or a pipe
                console.print(f"... {what}", highlight=False, markup=False)

        return prove(robot, progress=tell)


def _say_proof(proof: Proof) -> None:
    from tci.experiments.proof import POSTURES

    for axes in proof.axes:
        console.print(
            f"{axes.part}: axes within {axes.worst_deg:.2g} degrees of the generic arm's, in "
            f"{axes.within_limits} of {POSTURES} postures that the limits allow",
            highlight=False,
        )
    answered = sum(trial.responded for trial in proof.trials)
    console.print(f"reflexes: {answered} of {len(proof.trials)} pokes answered", highlight=False)
    moved = sum(patch.answered for patch in proof.patches)
    console.print(f"skin: {moved} of {len(proof.patches)} patches move away from a poke in their middle")
    for patch in proof.patches:
        if not patch.answered:
            why = escape(
                patch.reason or "no receptive field lies there; to add one: docs/withdrawal-reflex.md"
            )
            console.print(f"  note: {patch.patch} stays: {why}", style="yellow", highlight=False)
    for fault in proof.faults:
        console.print(f"  [red]{escape(fault)}[/]", highlight=False)
    end = (
        f"[red]{len(proof.faults)} fault{'s' * (len(proof.faults) > 1)}[/]"
        if proof.faults
        else "[green]proved in simulation[/]"
    )
    console.print(f"{proof.robot}: {end}")


def _say(name: str, robot: Robot, notes: list[str]) -> None:
    console.print(
        f"[green]{escape(name)} is valid[/]: {robot.name}, {len(robot.parts)} generic parts, "
        f"{len(robot.servos)} servos, {len(robot.patches)} patches of skin"
    )
    for note in notes:
        console.print(f"  note: {note}", style="yellow", highlight=False, markup=False)


def remarks(robot: Robot) -> list[str]:
    """What is allowed but worth knowing: a servo without limits can't be moved, and so on."""
    needed = ("lower", "upper", "velocity", "acceleration", "jerk")
    notes = []
    for part in robot.parts:
        for generic in part.servos:
            if generic.servo is None:
                notes.append(f"{part.name}: the robot lacks {generic.name}; it reads as fixed")
                continue
            servo = robot.servos[generic.servo]
            missing = [name for name in needed if getattr(servo.limits, name) is None]
            if missing:
                notes.append(
                    f"{part.name} {generic.name}: {servo.name} has no limit of {', '.join(missing)}, "
                    "so the gate will refuse to move it"
                )
    if robot.model is None:
        notes.append("no kinematic model: no simulation, no skin in space")
    if not robot.bindings:
        notes.append("no binding: no driver can reach it")
    return notes
