"""`tci touch`: touches a simulated robot that `tci serve` serves in another process."""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tci.cli import completion
from tci.cli.console import console, print_json
from tci.cli.options import AsJson, RobotName, TouchFile
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.robot.description import Robot


def touch(
    robot: RobotName,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            help="Touches, one in each argument: KIND PLACE, and if known force, speed, duration and "
            "onset, as for tci run --touch."
        ),
    ] = None,
    via: Annotated[
        str | None,
        typer.Option(
            help="Middleware over which the robot is served. \\[default: the one that is]",
            autocompletion=completion.servers,
        ),
    ] = None,
    touches: TouchFile = None,
    as_json: AsJson = False,
) -> None:
    """Touch a simulated robot that tci serve serves in another process of this machine.

    So a behaviour is rehearsed over any middleware: one process serves the robot, the behaviour connects to
    it, and this command touches it. It says what begins, waits until it is done, and says what was felt. The
    exit status is 1 if a touch could not be done.

    Example:  tci touch nao "stroke 'left forearm' 0.2..0.8 3N 8cm/s"

    Example:  tci touch nao --via yarp --touches visit.tsv
    """
    from tci.cli.pace import WORTH
    from tci.cli.touching import felt_words, tell_left_out, tell_rows
    from tci.robot.catalogue import load_robot

    if not words and touches is None:
        raise CommandError(f"nothing to do; valid: tci touch {robot} WORDS, or --touches FILE")
    described = load_robot(robot)
    asking = {"touch": words or [], "touches": None if touches is None else str(touches.absolute())}
    end: dict[str, Any] = {}
    for answer in _ask(described, via, asking):
        if "error" in answer:
            raise CommandError(answer["error"])
        if "begun" in answer and not as_json:
            tell_rows(described, answer["begun"])
            tell_left_out(described, answer["left_out"])
        end = answer if "done" in answer else end
    if not end:
        raise CommandError(f"the process that served {described.name} ended before the touch did")
    missed = end["missed_touches"]
    if as_json:
        print_json({"robot": described.name, "touches": end["done"], "missed_touches": missed})
    else:
        for row in end["done"]:
            felt = felt_words(described, row["patch"], row["felt_N"], row["force_N"])
            console.print(f"{row['kind']} {row['place']}: {felt}", highlight=False, markup=False)
        for reason in missed:
            console.print(f"a hand did not touch at {reason}", style="yellow", highlight=False, markup=False)
        if (pace := min(row["of_real_time"] for row in end["done"])) < WORTH:
            late = f"the simulation ran at {pace:.2f} of real time: whoever felt this felt it slowed down"
            console.print(late, style="yellow", highlight=False, markup=False)
    if missed:
        raise SystemExit(1)


def _ask(robot: Robot, via: str | None, asking: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Sends a question to the process that serves `robot`, and yields its answers. Raises CommandError if no
    process serves it, or several."""
    from tci.cli.touch_desk import desks

    if not hasattr(socket, "AF_UNIX"):
        raise CommandError("this system has no local sockets; valid here: tci serve ROBOT --touch")
    name, wanted = robot.name, None if via is None else via.partition(":")[0]
    found = list(desks(robot))
    served = [path for wires, path in found if wanted is None or wanted in wires.split("+")]
    here = f"{name} over {wanted}" if wanted else name
    over = ", ".join(f"--via {wires.split('+')[0]}" for wires, _ in found) or "none"
    if not served:
        raise CommandError(
            f"no process of yours on this machine serves {here} (served now: {over}); "
            f"valid: tci serve {name} --via {wanted or 'zenoh'} in another terminal"
        )
    if len(served) > 1:
        raise CommandError(f"{len(served)} processes serve {name}; valid: one of {over}, if they differ")
    with socket.socket(socket.AF_UNIX) as line:
        line.connect(str(served[0]))
        line.sendall(json.dumps(asking).encode() + b"\n")
        with line.makefile("rb") as answers:
            for answer in answers:
                yield json.loads(answer)
