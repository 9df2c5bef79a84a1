"""Commands that run robots: demo, view, run, record, serve, and plot for what was recorded."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tci.cli import completion
from tci.cli.options import (
    Arm,
    AsJson,
    Begin,
    Duration,
    End,
    Faults,
    RecordedRobot,
    RecordingFile,
    RobotName,
    SomeRobots,
    Via,
)

app = typer.Typer()


@app.command()
def demo(
    robot: SomeRobots = None,
    mode: Annotated[
        str, typer.Option(help="Form of the reflex: position, velocity, or impedance (soft arms).")
    ] = "position",
    out: Annotated[Path, typer.Option(help="Folder for report.json and demo.png.")] = Path("out"),
    seed: Annotated[int, typer.Option(min=0, help="Seed of the pokes' timing.")] = 0,
    headless: Annotated[
        bool, typer.Option("--headless", help="Never open the picture; nothing here needs a screen.")
    ] = False,
    skin_rate: Annotated[
        float | None, typer.Option(help="Skin frames per second instead of the robot's own \\[Hz].")
    ] = None,
    via: Annotated[
        str | None,
        typer.Option(
            help="Let the reflex run in another process, behind this middleware: NAME or NAME:ADDRESS.",
            autocompletion=completion.servers,
        ),
    ] = None,
    fault: Faults = None,
    view: Annotated[
        bool, typer.Option("--view", help="Then show the robots in the browser, to poke them yourself.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Poke simulated robots and watch the same withdrawal reflex answer on each of them.

    A compliant finger pokes five sites of both arms, with the reflex and without it. The table tells
    what was measured; OUT/demo.png shows it and OUT/report.json has every figure.

    With --fault, one poke of one robot is rehearsed with that fault, and told as it happens.

    With --via, the robot is served as by tci serve, in real time, and the reflex reaches it from outside.

    Example:  tci demo nao --out /path/to/folder

    Example:  tci demo --fault stall@0.32
    """
    if fault:
        from tci.cli.run import run_capability
        from tci.errors import CommandError

        if view or via or skin_rate or mode != "position" or len(robot or ()) > 1:
            raise CommandError("--fault rehearses one poke of one robot; valid beside it: ROBOT, --json")

        run_capability(
            "withdrawal", (robot or ["nao"])[0], rehearsal=True, poke=True, faults=fault, as_json=as_json
        )
        return
    from tci.cli.demo import demo as command

    if view:
        from tci.cli.view import needs_viewer

        needs_viewer()
    command(
        robot or [], mode=mode, out=out, seed=seed, headless=headless, skin_rate=skin_rate, via=via,
        as_json=as_json,
    )  # fmt: skip
    if view:
        from tci.cli.view import view as show

        show(robot or [], [], port=0, folder=out / "recordings", browser=not headless)


@app.command()
def view(
    robot: SomeRobots = None,
    via: Annotated[
        list[str] | None,
        typer.Option(
            help="Driver, NAME or NAME:ADDRESS: one for all robots, or one for each. \\[default: sim]",
            autocompletion=completion.drivers,
        ),
    ] = None,
    capability: Annotated[
        str,
        typer.Option(
            "--run",
            help="Capability that runs on every robot, by name or MODULE:CLASS.",
            autocompletion=completion.capabilities,
        ),
    ] = "withdrawal",
    arm: Arm = False,
    host: Annotated[
        str, typer.Option(help="Address to listen on; off this machine a token is asked for.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port; 0 takes a free one.")] = 8080,
    out: Annotated[Path, typer.Option(help="Folder for recordings.")] = Path("recordings"),
    duration: Duration = None,
    headless: Annotated[bool, typer.Option("--headless", help="Do not open the browser.")] = False,
) -> None:
    """Show robots in the browser, side by side: poke their skin, move their arms, make faults happen, record.

    Needs the extra `viewer`. A real robot is read-only without --arm.

    Example:  tci view nao icub

    Example:  tci view --via replay:touch.mcap
    """
    from tci.cli.view import view as command

    command(
        robot or [], via or [], capability=capability, arm=arm, host=host, port=port,
        folder=out, duration=duration, browser=not headless,
    )  # fmt: skip


@app.command()
def run(
    capability: Annotated[
        str,
        typer.Argument(
            help="Capability: a name such as withdrawal, or MODULE:CLASS.",
            autocompletion=completion.capabilities,
        ),
    ],
    robot: RobotName,
    via: Via = "sim",
    duration: Duration = None,
    arm: Arm = False,
    poke: Annotated[bool, typer.Option("--poke", help="A simulated finger pokes the left forearm.")] = False,
    fault: Faults = None,
    record: Annotated[Path | None, typer.Option(help="Record all of it to this new file (.mcap).")] = None,
    film: Annotated[
        Path | None,
        typer.Option(help="Film a simulated robot, 3x slower: .gif, .webp, .png; .mp4 (extra: video)."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a capability on a robot, and tell what gate and loop do.

    Exit status 1 when the robot had to stop, or when every command was refused. A real robot is read-only
    without --arm.

    Example:  tci run withdrawal nao --duration 1 --poke --fault stall@0.32

    Example:  tci run withdrawal nao --via replay:touch.mcap
    """
    from tci.cli.run import run_capability

    run_capability(
        capability,
        robot,
        via=via,
        duration=duration,
        arm=arm,
        poke=poke,
        faults=fault or [],
        record=record,
        film=film,
        as_json=as_json,
    )


@app.command()
def record(
    file: Annotated[Path, typer.Argument(help="The recording to write (.mcap), a new file.")],
    robot: RobotName,
    via: Via = "sim",
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Record what a robot senses, raw. Nothing is commanded, and no robot has to be armed.

    `tci run --record` records a behaviour too. Look with tci log; replay with --via replay:FILE.

    Example:  tci record touch.mcap nao --duration 10
    """
    from tci.cli.record import record as command

    command(file, robot, via=via, duration=duration, as_json=as_json)


@app.command()
def serve(
    robot: RobotName,
    via: Annotated[
        str,
        typer.Option(help="How others reach it: NAME or NAME:ADDRESS.", autocompletion=completion.servers),
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            help="Driver to the robot itself, NAME or NAME:ADDRESS.",
            autocompletion=completion.drivers,
        ),
    ] = "sim",
    arm: Arm = False,
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Show a robot, real or simulated, to other programs. Gate and lease are those of this process.

    Exit status 1 when the robot had to stop.

    Example:  tci serve nao --via zenoh
    """
    from tci.cli.serve import serve as command

    command(robot, via=via, source=source, arm=arm, duration=duration, as_json=as_json)


@app.command()
def plot(
    file: RecordingFile,
    out: Annotated[
        Path | None, typer.Option(help="File to write: png, pdf or svg. \\[default: beside the recording]")
    ] = None,
    robot: RecordedRobot = None,
    part: Annotated[str | None, typer.Option(help="Part to draw. \\[default: the one touched first]")] = None,
    begin: Begin = float("-inf"),
    end: End = float("inf"),
    as_json: AsJson = False,
) -> None:
    """Draw a recording for a paper: forces, response, joint angles, the skin unrolled, latencies.

    Example:  tci plot touch.mcap --out touch.pdf
    """
    from tci.cli.plot import plot as command

    command(file, out, robot=robot, part=part, begin=begin, end=end, as_json=as_json)
