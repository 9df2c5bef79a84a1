"""The `tci` command. Each command imports what it needs when it runs, so that --help is quick."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from tci.cli.fault import app as fault_app
from tci.cli.gesture import app as gesture_app
from tci.cli.log import app as log_app
from tci.cli.skin import app as skin_app
from tci.cli.zenoh import app as zenoh_app
from tci.errors import DescriptionError, TciError

app = typer.Typer(
    name="tci",
    help="Tactile Capabilities Interface: write a touch behaviour once, run it on any humanoid.",
    epilog="Start with: tci demo. This is software, not a certified safety function.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
)

app.add_typer(skin_app, name="skin")
app.add_typer(fault_app, name="fault")
app.add_typer(gesture_app, name="gesture")
app.add_typer(log_app, name="log")
app.add_typer(zenoh_app, name="zenoh")

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON for programs instead of a table.")]


Faults = Annotated[
    list[str] | None,
    typer.Option(help="NAME@TIME or NAME@TIME:DURATION \\[s]; names: tci fault list; repeat for several."),
]


@app.command()
def demo(
    robot: Annotated[
        list[str] | None,
        typer.Option(
            "--robot",
            "-r",
            help="Robot by name or description file; repeat for several. "
            "[default: the paper's two, nao and icub, where installed]",
        ),
    ] = None,
    mode: Annotated[
        str, typer.Option(help="Form of the reflex: position, velocity, or impedance (soft arms).")
    ] = "position",
    out: Annotated[Path, typer.Option(help="Folder for report.json and demo.png.")] = Path("out"),
    seed: Annotated[int, typer.Option(help="Seed of the pokes' timing.")] = 0,
    headless: Annotated[
        bool, typer.Option("--headless", help="Never open the picture; nothing here needs a screen.")
    ] = False,
    skin_rate: Annotated[
        float | None, typer.Option(help="Skin frames per second instead of the robot's own \\[Hz].")
    ] = None,
    via: Annotated[
        str | None,
        typer.Option(
            help="Let the reflex run in another process, behind this middleware: NAME or NAME:ADDRESS."
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

    Example:  tci demo --robot nao --out /path/to/folder

    Example:  tci demo --fault stall@0.32
    """
    if fault:
        from tci.cli.run import run_capability

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
    robot: Annotated[
        list[str] | None,
        typer.Option(
            "--robot",
            "-r",
            help="Robot by name or description file; repeat for several. "
            "[default: the paper's two, nao and icub, where installed]",
        ),
    ] = None,
    via: Annotated[
        list[str] | None,
        typer.Option(help="Link, NAME or NAME:ADDRESS: one for all robots, or one for each. [default: sim]"),
    ] = None,
    capability: Annotated[
        str, typer.Option("--run", help="Capability that runs on every robot.")
    ] = "withdrawal",
    arm: Annotated[bool, typer.Option("--arm", help="Let it move; a simulated robot always may.")] = False,
    host: Annotated[
        str, typer.Option(help="Address to listen on; off this machine a token is asked for.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; 0 takes a free one.")] = 8080,
    out: Annotated[Path, typer.Option(help="Folder for recordings.")] = Path("recordings"),
    duration: Annotated[float | None, typer.Option(help="How long \\[s]; else until interrupted.")] = None,
    headless: Annotated[bool, typer.Option("--headless", help="Do not open the browser.")] = False,
) -> None:
    """Show robots in the browser, side by side: poke their skin, move their arms, make faults happen, record.

    Needs the extra: pip install 'tci\\[viewer]'. A real robot is read-only without --arm.

    Example:  tci view --robot nao --robot icub

    Example:  tci view --via replay:touch.mcap
    """
    from tci.cli.view import view as command

    command(
        robot or [], via or [], capability=capability, arm=arm, host=host, port=port,
        folder=out, duration=duration, browser=not headless,
    )  # fmt: skip


@app.command()
def run(
    capability: Annotated[str, typer.Argument(help="Name of a capability, such as withdrawal.")],
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot by name or description file.")],
    via: Annotated[str, typer.Option(help="Link to it, NAME or NAME:ADDRESS.")] = "sim",
    duration: Annotated[float | None, typer.Option(help="How long \\[s]; else until interrupted.")] = None,
    arm: Annotated[bool, typer.Option("--arm", help="Let it move; a simulated robot always may.")] = False,
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

    Exit status 1 when the robot had to stop. A real robot is read-only without --arm.

    Example:  tci run withdrawal --robot nao --duration 1 --poke --fault stall@0.32

    Example:  tci run withdrawal --robot nao --via replay:touch.mcap
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
    robot: Annotated[str, typer.Option("--robot", "-r", help="Robot by name or description file.")],
    via: Annotated[str, typer.Option(help="Link to it, NAME or NAME:ADDRESS.")] = "sim",
    duration: Annotated[float | None, typer.Option(help="How long \\[s]; else until interrupted.")] = None,
    as_json: AsJson = False,
) -> None:
    """Record what a robot senses, raw. Nothing is commanded, and no robot has to be armed.

    `tci run --record` records a behaviour too. Look with tci log; replay with --via replay:FILE.

    Example:  tci record touch.mcap --robot nao --duration 10
    """
    from tci.cli.record import record as command

    command(file, robot, via=via, duration=duration, as_json=as_json)


@app.command()
def serve(
    robot: Annotated[str, typer.Argument(help="Robot by name, or a description file.")],
    via: Annotated[str, typer.Option(help="How others reach it: NAME or NAME:ADDRESS.")],
    source: Annotated[
        str, typer.Option("--from", help="Link to the robot itself, NAME or NAME:ADDRESS.")
    ] = "sim",
    arm: Annotated[bool, typer.Option("--arm", help="Let it move; a simulated robot always may.")] = False,
    duration: Annotated[float | None, typer.Option(help="How long \\[s]; else until interrupted.")] = None,
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
    file: Annotated[Path, typer.Argument(help="Recording (.mcap).")],
    out: Annotated[
        Path | None, typer.Option(help="File to write: png, pdf or svg. [default: beside the recording]")
    ] = None,
    robot: Annotated[
        str | None, typer.Option("--robot", "-r", help="Its description, if it is not one that TCI knows.")
    ] = None,
    part: Annotated[str | None, typer.Option(help="Part to draw. [default: the one touched first]")] = None,
    begin: Annotated[float, typer.Option("--from", help="Begin \\[s] on its clock.")] = float("-inf"),
    end: Annotated[float, typer.Option("--to", help="End \\[s].")] = float("inf"),
    as_json: AsJson = False,
) -> None:
    """Draw a recording for a paper: forces, response, joint angles, the skin unrolled, latencies.

    Example:  tci plot touch.mcap --out touch.pdf
    """
    from tci.cli.plot import plot as command

    command(file, out, robot=robot, part=part, begin=begin, end=end, as_json=as_json)


@app.command()
def robots(as_json: AsJson = False) -> None:
    """List the robots that TCI knows."""
    from tci.cli.robots import robots as command

    command(as_json=as_json)


@app.command()
def describe(
    robot: Annotated[str, typer.Argument(help="Robot by name, or a description file.")],
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
    name: Annotated[str | None, typer.Option(help="Name of the robot [default: the file's].")] = None,
    package: Annotated[
        str | None, typer.Option(help="Installed Python package that brought the URDF, if one did.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Description to write [default: robot.xml beside the URDF].")
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
    file: Annotated[
        Path, typer.Argument(help="Robot description (XML); with --hardware a robot's name will do.")
    ],
    simulate: Annotated[
        bool, typer.Option("--simulate", help="Prove it in simulation: axes, limits, reflexes.")
    ] = False,
    hardware: Annotated[
        bool, typer.Option("--hardware", help="Prove it on the robot itself, joint by joint, taxel by taxel.")
    ] = False,
    via: Annotated[str, typer.Option(help="With --hardware: link to it, NAME or NAME:ADDRESS.")] = "sim",
    only: Annotated[
        list[str] | None,
        typer.Option(help="With --hardware: a part, a joint or a patch; repeat for several."),
    ] = None,
    taxels: Annotated[int, typer.Option(help="With --hardware: taxels of each patch; -1: all.")] = 12,
    as_json: AsJson = False,
) -> None:
    """Check a robot description: every fault at once, each with its line and what would be valid.

    With --simulate the axes of its arms are compared with the generic arm's, both arms are sent far outside
    their limits, and every field of the withdrawal reflex is poked.

    With --hardware the robot itself is looked at; then each joint moves by 2 degrees, slowly, after you were
    asked, and you are asked what you saw; then you press its skin. Wrong signs, zeros, limits and units show.

    Exit status 0 when the file is valid and proved, 1 when it is not.

    Example:  tci check my-robot.xml --simulate

    Example:  tci check nao --hardware --via naoqi://10.0.0.5 --only left_arm
    """
    if hardware:
        from tci.cli.hardware import check_hardware

        check_hardware(str(file), via=via, parts=only or [], taxels=taxels, as_json=as_json)
        return
    from tci.cli.check import check as command

    command(file, simulate=simulate, as_json=as_json)


@app.command()
def doctor(
    robot: Annotated[
        str | None, typer.Option("--robot", "-r", help="Robot by name or description file.")
    ] = None,
    via: Annotated[str | None, typer.Option(help="Link to it, NAME or NAME:ADDRESS.")] = None,
    duration: Annotated[float, typer.Option(help="How long to read the robot [s].", min=0.1)] = 2.0,
    as_json: AsJson = False,
) -> None:
    """Find out what works, what does not, and what to do about it. Nothing moves.

    Without a robot: this machine. With one: what can be reached, rates, lost frames, ages, and where
    robot and description disagree. Exit status 1 when there is a fault.

    Example:  tci doctor

    Example:  tci doctor --robot nao --via sim
    """
    from tci.cli.doctor import doctor as command

    command(robot, via, duration=duration, as_json=as_json)


def _said(error: TciError | OSError) -> str:
    """An error in words; of a file its name and what the system says."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def main() -> None:
    """Entry point: errors of TCI and of files become one message and exit status 1."""
    try:
        app()
    except (TciError, OSError) as error:
        if "--json" in sys.argv and isinstance(error, DescriptionError):
            faults = [{"line": fault.line, "message": fault.message} for fault in error.faults]
            print(json.dumps({"error": str(error).splitlines()[0], "faults": faults}, indent=2))
        elif "--json" in sys.argv:
            print(json.dumps({"error": _said(error)}, indent=2))
        else:
            print(f"tci: {_said(error)}", file=sys.stderr)
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
