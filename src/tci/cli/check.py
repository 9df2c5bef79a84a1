"""`tci check`: checks a robot description, and tests the robot in simulation or on hardware."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from tci.cli import completion
from tci.cli.console import console, print_json, told_here
from tci.cli.options import AsJson, RobotName, Touches, TouchFile
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.lab.experiments.proof import Proof
    from tci.lab.experiments.verdict import Verdict
    from tci.robot.description import Robot
    from tci.touches.planned_touch import PlannedTouch


PROVED = {
    "described": "proved in simulation",
    "assumed": "proved on assumed skin",
    "none": "axes and limits proved in simulation; it has no skin to touch",
    "unanswered": "axes and limits proved in simulation; no withdrawal reflex covers any of its skin",
}


def check(
    robot: RobotName,
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Test the robot in simulation: axes, limits and reflexes.")
    ] = False,
    hardware: Annotated[
        bool, typer.Option("--hardware", help="Test the real robot, joint by joint and taxel by taxel.")
    ] = False,
    via: Annotated[
        str,
        typer.Option(
            help="With --hardware: driver that connects to the robot, NAME or NAME:ADDRESS.",
            autocompletion=completion.drivers,
        ),
    ] = "sim",
    only: Annotated[
        list[str] | None,
        typer.Option(
            help="With --hardware: test only this part, joint or patch. Repeat the option for several."
        ),
    ] = None,
    taxels: Annotated[
        int,
        typer.Option(min=-1, help="With --hardware: number of taxels to press on each patch, -1 for all."),
    ] = 12,
    friction: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="With --hardware: also measure the friction of joints that detect touches, and write FILE.",
        ),
    ] = None,
    touch: Touches = None,
    touches: TouchFile = None,
    as_json: AsJson = False,
) -> None:
    """Check a robot description. Prints each fault with the line in the file and the valid values.

    Also simulates the robot for a moment, compares the axes of its arms with the axes of the generic arm, and
    commands both arms to angles far outside the limits: tci new-robot writes only what passes this. Then
    compares the description with its kinematic model, and the left side of the robot with its right side.
    The comparison finds values that are valid in the file format but probably wrong: limits, signs, links,
    positions and units.

    --simulate also touches the simulated robot. A finger pokes every receptive field (skin region that
    triggers a reflex) of the withdrawal reflexes and the middle of every patch. The touched part must move
    away from the finger. With --touch or --touches, people also touch the robot, in the words of tci run,
    while its reflex answers.

    --hardware tests the real robot. The test first reads joints and skin. Then the test moves one joint after
    another slowly by 2 degrees. Before each motion, the test asks for your permission; after the motion, the
    test asks about the motion that you saw. Finally, the test asks you to press the skin. The test finds
    wrong signs, zeros, limits and units. --friction also measures the friction of each joint of limbs without
    skin. For this measurement, the test asks for your permission and then moves the joint slowly by 10
    degrees and back, at two speeds.

    The exit status is 0 if the file is valid and the tests passed, otherwise 1.

    Example:  tci check my-robot.xml --simulate

    Example:  tci check nao --hardware --via naoqi://10.0.0.5 --only left_arm
    """
    if hardware:
        from tci.cli.hardware import check_hardware

        check_hardware(robot, via=via, parts=only or [], taxels=taxels, friction=friction, as_json=as_json)
        return
    if via != "sim" or only or taxels != 12 or friction is not None:
        raise CommandError(
            "--via, --only, --taxels and --friction need a robot to test; valid: add --hardware"
        )
    from tci.cli.touching import ask, tell_left_out
    from tci.lab.commissioning.plausibility import doubts
    from tci.lab.experiments.verdict import judge
    from tci.robot.catalogue import load_robot

    found = load_robot(robot)
    asked = ask(found, touch or [], touches)
    if asked is not None and not simulate:
        raise CommandError("--touch and --touches need a simulation; valid: add --simulate")
    planned = () if asked is None else asked.planned
    if asked is not None and not as_json:
        tell_left_out(found, asked.not_here())
    with told_here():  # it commands angles outside all limits on purpose, so the log would list clamps
        verdict = judge(found)
    proof = _prove(found, verdict, planned, quiet=as_json) if simulate else None
    faults = verdict.faults if proof is None else proof.faults
    notes = remarks(found)
    doubtful = doubts(found) if verdict.axes or verdict.missing else []
    if as_json:
        about = {"robot": found.name, "valid": not faults, "faults": faults, "remarks": notes}
        simulated = {} if proof is None else {"simulated": proof.to_json()}
        left_out = {} if asked is None else {"left_out": asked.not_here()}
        print_json({**about, "doubts": doubtful, **left_out, **simulated})
    else:
        _print_check(robot, found, notes, doubtful, faults=() if simulate else faults)
        if proof is not None:
            _print_proof(found, proof)
    if faults:
        raise SystemExit(1)


def _prove(robot: Robot, verdict: Verdict, touches: Sequence[PlannedTouch], *, quiet: bool) -> Proof:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from tci.lab.experiments.proof import prove

    columns = (TextColumn("{task.description:<32}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        task = progress.add_task("touching it", total=11 + len(robot.patches))

        def show(what: str) -> None:
            progress.update(task, advance=1, description=what)
            if not quiet and not console.is_terminal:  # a progress bar is only shown on a terminal
                console.print(f"... {what}", highlight=False, markup=False)

        with told_here():
            return prove(robot, verdict=verdict, touches=touches, progress=show)


def _print_proof(robot: Robot, proof: Proof) -> None:
    from tci.lab.experiments.verdict import POSTURES

    for axes in proof.axes:
        console.print(
            f"{axes.part}: axes at most {axes.worst_deg:.2g} degrees from the generic arm's, compared in the "
            f"{axes.within_limits} of {POSTURES} postures that the limits allow",
            highlight=False,
        )
    if proof.trials or proof.patches or not proof.faults:
        _print_touches(robot, proof)
    else:
        console.print("touches: not tried before these faults are mended", highlight=False)
    for fault in proof.faults:
        console.print(f"  [red]{escape(fault)}[/]", highlight=False)
    end = (
        f"[red]{len(proof.faults)} fault{'s' * (len(proof.faults) > 1)}[/]"
        if proof.faults
        else f"[green]{PROVED[proof.skin]}[/]"
    )
    console.print(f"{proof.robot}: {end}")


def _print_touches(robot: Robot, proof: Proof) -> None:
    from tci.cli.touching import felt_words

    answered = sum(trial.responded for trial in proof.trials)
    if proof.without_skin:
        bare = ", ".join(proof.without_skin)
        console.print(f"  note: no skin on {bare}: no touch was tried there", style="yellow", highlight=False)
    console.print(f"reflexes: {answered} of {len(proof.trials)} pokes answered", highlight=False)
    moved = sum(patch.answered for patch in proof.patches)
    console.print(f"skin: {moved} of {len(proof.patches)} patches moved away from a poke in their middle")
    for patch in proof.patches:
        if not patch.answered and not patch.fault:  # faults are told on their own
            why = escape(
                patch.reason or "no receptive field of the two withdrawal reflexes covers this place"
            )
            console.print(f"  note: {patch.patch} did not move: {why}", style="yellow", highlight=False)
    for touch in proof.touches:
        felt = felt_words(robot, touch.patch, touch.felt_n, touch.asked_n)
        words = f"{touch.kind} {touch.place}, on {touch.patch}: {felt}"
        console.print(words, highlight=False, markup=False)


def _print_check(
    name: str, robot: Robot, notes: list[str], doubtful: list[str], *, faults: Sequence[str]
) -> None:
    is_valid = "[red]{} can't be simulated and proved[/]" if faults else "[green]{} is valid[/]"
    console.print(
        f"{is_valid.format(escape(name))}: {robot.name}, {len(robot.parts)} generic parts, "
        f"{len(robot.servos)} servos, {len(robot.skin)} patches of skin"
    )
    for fault in faults:
        console.print(f"  {fault}", style="red", highlight=False, markup=False)
    for note in notes:
        console.print(f"  note: {note}", style="yellow", highlight=False, markup=False)
    for doubt in doubtful:
        console.print(f"  doubtful: {doubt}", style="red", highlight=False, markup=False)


def remarks(robot: Robot) -> list[str]:
    """Returns a remark for each property of a description that is valid but restricts the robot's use. An
    example is a servo without limits, since the gate refuses to move such a servo.
    """
    from tci.drivers.registry import source_names
    from tci.lab.commissioning.assumptions import powers, too_quick
    from tci.lab.commissioning.in_the_way import in_the_way
    from tci.lab.experiments.verdict import limbs_missing
    from tci.robot.model_file import LEAST_MASS, assumed_masses
    from tci.robot.xml.node import listed

    needed = ("lower", "upper", "velocity", "acceleration", "jerk")
    notes = []
    for part in robot.parts:
        absent = [generic.name for generic in part.servos if generic.servo is None]
        if absent:
            notes.append(
                f"{part.name}: no joint of the robot is mapped to {', '.join(absent)}; read as constant"
            )
        for generic in part.servos:
            if generic.servo is None:
                continue
            servo = robot.servos[generic.servo]
            missing = [name for name in needed if getattr(servo.limits, name) is None]
            if missing:
                notes.append(
                    f"{part.name} {generic.name}: {servo.name} has no limit of {', '.join(missing)}, "
                    "so the gate refuses to move it; add the limit to the description"
                )
    for via in (via for binding in robot.bindings for via in binding.sources):
        if via.partition(":")[0] not in source_names():
            notes.append(f"source {via}: not installed; valid: {', '.join(source_names())}")
    if assumed := [patch.name for patch in robot.patches if patch.assumed]:
        notes.append(f"assumed skin, which nobody has seen on the robot: {', '.join(assumed)}")
    if robot.model is None:
        notes.append("no kinematic model: the robot can't be simulated, and its skin has no place in space")
    elif lacks := limbs_missing(robot):
        notes.append(f"{lacks}: tci check --simulate proves robots with arms or hands")
    if robot.model is not None and (light := assumed_masses(robot.model)):
        notes.append(
            f"assumed mass of {LEAST_MASS * 1e3:g} g, as the model has none or 0: {listed(light, most=8)}"
        )
    return [*notes, *too_quick(robot), *powers(robot), *in_the_way(robot)]
