"""Commands about robots: robots, describe, new-robot, check, doctor."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli import completion
from tci.cli.options import AsJson, RobotName
from tci.errors import CommandError

app = typer.Typer()


@app.command()
def robots(as_json: AsJson = False) -> None:
    """List the robots that TCI knows."""
    from tci.cli.robots import robots as command

    command(as_json=as_json)


@app.command()
def describe(
    robot: RobotName,
    form: Annotated[
        str,
        typer.Option(
            "--format",
            "-f",
            help="table; json: every fact, SI units; dh: Denavit-Hartenberg tables; "
            "urdf: a model for Pinocchio and others; kdl: chains for OROCOS KDL.",
        ),
    ] = "table",
    as_json: AsJson = False,
) -> None:
    """Show a robot: its generic parts with their maps and limits, and its skin.

    Example:  tci describe nao --format dh
    """
    from tci.cli.describe import describe as command

    command(robot, form=form, as_json=as_json)


@app.command("new-robot")
def new_robot(
    urdf: Annotated[Path, typer.Argument(help="The robot's URDF.")],
    name: Annotated[str | None, typer.Option(help="Name of the robot \\[default: the file's].")] = None,
    package: Annotated[
        str | None, typer.Option(help="Installed Python package that brought the URDF, if one did.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Description to write \\[default: robot.xml beside the URDF].")
    ] = None,
    mount: Annotated[
        bool,
        typer.Option(
            "--mount", help="Eq. 1 on a mount for shoulders that are the generic one but for a small turn."
        ),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace a description that exists.")] = False,
    as_json: AsJson = False,
) -> None:
    """Propose the description of a humanoid from its URDF.

    Finds arms, hands, head, torso and legs by their geometry, takes limits from the file and puts sleeves of
    skin around the arms. Look the result over; what no file says is marked as ours in it.

    Example:  tci new-robot my_robot.urdf
    """
    from tci.cli.new_robot import new_robot as command

    command(urdf, name=name, package=package, out=out, mount=mount, force=force, as_json=as_json)


@app.command()
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
    from tci.cli.check import check as command

    command(robot, simulate=simulate, as_json=as_json)


@app.command()
def doctor(
    robot: Annotated[
        str | None,
        typer.Argument(help="Robot by name, or a description file.", autocompletion=completion.robots),
    ] = None,
    via: Annotated[
        str | None,
        typer.Option(help="Driver that reaches it, NAME or NAME:ADDRESS.", autocompletion=completion.drivers),
    ] = None,
    duration: Annotated[float, typer.Option(help="How long to read the robot \\[s].", min=0.1)] = 2.0,
    as_json: AsJson = False,
) -> None:
    """Find out what works, what does not, and what to do about it. Nothing moves.

    Without a robot: this machine. With one: what can be reached, rates, lost frames, ages, and where
    robot and description disagree. Exit status 1 when there is a fault.

    Example:  tci doctor

    Example:  tci doctor nao --via sim
    """
    from tci.cli.doctor import doctor as command

    command(robot, via, duration=duration, as_json=as_json)
