"""`tci doctor`: examines this machine and the connection to a robot. The command moves no robot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import box
from rich.markup import escape

from tci.cli.console import console, print_json
from tci.cli.options import AsJson, OptionalRobot, OptionalVia
from tci.drivers.diagnosis import Finding, Level
from tci.errors import DriverError, MissingExtraError, TciError, UnknownNameError

if TYPE_CHECKING:
    from rich.table import Table

    from tci.lab.commissioning.streams import Stream
    from tci.robot.description import Robot


MARKS = {Level.OK: "[green]ok[/]", Level.NOTE: "[cyan]note[/]", Level.WARNING: "[yellow]warning[/]",
         Level.FAULT: "[bold red]fault[/]"}  # fmt: skip


def doctor(
    robot: OptionalRobot = None,
    via: OptionalVia = None,
    duration: Annotated[
        float, typer.Option(help="Time \\[s] for which the command reads the robot's data.", min=0.1)
    ] = 2.0,
    as_json: AsJson = False,
) -> None:
    """Find faults of this machine or of the connection to a robot, and print advice. Moves no robot. Without
    the name of a robot, the command examines this machine. With the name of a robot, the command examines the
    connection to the robot: each step of connecting, frame rates, lost frames and the age of the data. The
    command also compares the robot with the robot's description. The exit status is 1 if the command finds a
    fault.

    Example:  tci doctor

    Example:  tci doctor nao --via sim
    """
    from tci.lab.commissioning.machine import examine_machine
    from tci.robot.catalogue import load_robot

    if via is None and robot is None:
        print_findings("this machine", examine_machine(), (), as_json=as_json)
        return
    if robot is None:
        raise DriverError(f"--via {via} needs the robot's name; valid: tci doctor ROBOT --via {via}")
    if via is None and not as_json:
        console.print("checks the simulation; for a real robot give --via NAME:ADDRESS", style="dim")
    via = via or "sim"
    findings, streams = _examine(load_robot(robot), via, duration, quiet=as_json)
    print_findings(f"{robot} via {via}", findings, streams, as_json=as_json)


def _examine(
    robot: Robot, via: str, duration: float, *, quiet: bool
) -> tuple[tuple[Finding, ...], tuple[Stream, ...]]:
    """Examines the connection to the robot, then reads the robot through its driver for `duration` [s].

    Returns the findings and the measured data streams. If the driver can't be opened, the list of streams is
    empty.
    """
    from rich.progress import BarColumn, Progress, TextColumn

    from tci.drivers.combined_server import JOIN
    from tci.drivers.registry import connect, examine_sources, load_driver, source_names
    from tci.lab.commissioning.doctor import judge
    from tci.lab.commissioning.streams import observe

    name, found = "", tuple[Finding, ...]()
    try:
        for part in via.split(JOIN):
            name, _, address = part.partition(":")
            if name not in source_names():
                found += load_driver(name).probe(robot, address)
        if any(finding.level is Level.FAULT for finding in found):
            return (*found, *examine_sources(robot, via)), ()
        driver = connect(robot, via, arm=False)
    except UnknownNameError as error:
        if error.kind in ("driver", "source"):
            raise
        advice = f"add <binding middleware={name!r} .../> to the description of {robot.name}"
        return (Finding(Level.FAULT, "description", str(error), advice),), ()
    except MissingExtraError as error:
        return (Finding(Level.FAULT, "connection", str(error)),), ()
    except TciError as error:
        found += examine_sources(robot, via)
        told = any(finding.what == str(error) for finding in found)
        return (found if told else (*found, Finding(Level.FAULT, "connection", str(error)))), ()
    columns = (TextColumn("reading {task.description}"), BarColumn())
    with driver, Progress(*columns, console=console, disable=quiet, transient=True) as progress:
        task = progress.add_task(f"{robot.name} for {duration:g} s", total=1.0)
        try:
            seen = observe(driver, duration, progress=lambda share: progress.update(task, completed=share))
            return (*found, *judge(driver, seen)), seen.streams
        except TciError as error:
            return (*found, Finding(Level.FAULT, "connection", f"lost while reading: {error}")), ()


def print_findings(
    title: str, findings: Sequence[Finding], streams: Sequence[Stream], *, as_json: bool
) -> None:
    """Prints findings and ends with status 1 if one is a fault."""
    counts = Counter(finding.level for finding in findings)
    if as_json:
        report: dict[str, Any] = {
            "what": title,
            "healthy": not counts[Level.FAULT],
            "counts": {level.value: counts[level] for level in Level},
            "findings": [finding.to_json() for finding in findings],
            "streams": [
                {key: _finite(value) for key, value in stream.to_json().items()} for stream in streams
            ],
        }
        print_json(report)
    else:
        console.print(_table(title, findings))
        for finding in findings:
            if finding.advice and finding.level is not Level.OK:
                console.print(
                    f"{MARKS[finding.level]} {escape(finding.subject)}: {escape(finding.advice)}",
                    highlight=False,
                )
        words = {Level.FAULT: "fault", Level.WARNING: "warning", Level.NOTE: "note"}
        said = [f"{counts[level]} {word}{'s' * (counts[level] != 1)}" for level, word in words.items()]
        console.print(", ".join(said), highlight=False)
    if counts[Level.FAULT]:
        raise SystemExit(1)


def _table(title: str, findings: Sequence[Finding]) -> Table:
    from rich.table import Table

    table = Table(
        "", "", "found", title=escape(title), box=box.SIMPLE_HEAD, show_header=False, pad_edge=False
    )
    for finding in findings:
        table.add_row(MARKS[finding.level], escape(finding.subject), escape(finding.what))
    return table


def _finite(value: object) -> object:
    """Returns `value`, or None if `value` is infinite, because JSON has no infinity. For example, the age of
    data that never arrived is infinite."""
    return None if isinstance(value, float) and value in (float("inf"), float("-inf")) else value
