"""`tci check`."""

from __future__ import annotations

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from tci.cli.console import console, print_json
from tci.experiments.proof import POSTURES, Proof, prove
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot


def check(name: str, *, simulate: bool, as_json: bool) -> None:
    """Read a robot's description, and try it in simulation if asked to: then exit status 1 when it fails.

    Raises DescriptionError with every fault; prints what to know otherwise.
    """
    robot = load_robot(name)
    notes = list(remarks(robot))
    proof = _prove(robot, quiet=as_json) if simulate else None
    if as_json:
        told = {} if proof is None else {"simulated": proof.to_json()}
        print_json({"robot": robot.name, "valid": True, "remarks": notes, **told})
    else:
        _say(name, robot, notes)
        if proof is not None:
            _say_proof(proof)
    if proof is not None and proof.faults:
        raise SystemExit(1)


def _prove(robot: Robot, *, quiet: bool) -> Proof:
    columns = (TextColumn("{task.description:<32}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        task = progress.add_task("reading the model", total=14 + len(robot.patches))

        def tell(what: str) -> None:
            progress.update(task, advance=1, description=what)
            if not quiet and not console.is_terminal:  # there is no bar in a file or a pipe
                console.print(f"... {what}", highlight=False, markup=False)

        return prove(robot, progress=tell)


def _say_proof(proof: Proof) -> None:
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
