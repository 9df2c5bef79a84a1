"""`tci demo`: pokes simulated robots, prints a table, and writes a picture and a report."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated

import typer
from rich import box
from rich.markup import escape

from tci.cli import completion
from tci.cli.console import console, print_json, told_here
from tci.cli.guide import next_command
from tci.cli.options import AsJson, Faults, SomeRobots, Touches, TouchFile
from tci.cli.robots import load_robots
from tci.errors import CommandError, UnknownNameError

if TYPE_CHECKING:
    from rich.table import Table

    from tci.lab.experiments.experiment import Report
    from tci.lab.experiments.measure import Trial
    from tci.lab.experiments.same_touch import SameTouch
    from tci.messages import Mode
    from tci.robot.description import Robot


def demo(
    robot: SomeRobots = None,
    mode: Annotated[
        str,
        typer.Option(help="Control mode of the reflex: position, velocity, or impedance (compliant arms)."),
    ] = "position",
    out: Annotated[Path, typer.Option(help="Folder for report.json and demo.png.")] = Path("out"),
    seed: Annotated[int, typer.Option(min=0, help="Random seed for the places and times of the pokes.")] = 0,
    headless: Annotated[
        bool, typer.Option("--headless", help="Do not open the picture or a browser.")
    ] = False,
    skin_rate: Annotated[
        float | None,
        typer.Option(help="Frame rate of the skin \\[Hz]. \\[default: the rate in each robot's description]"),
    ] = None,
    via: Annotated[
        str | None,
        typer.Option(
            help="Run the reflex in another process, through this middleware: NAME or NAME:ADDRESS, or "
            "several with ' + ' between them.",
            autocompletion=completion.servers,
        ),
    ] = None,
    fault: Faults = None,
    touch: Touches = None,
    touches: TouchFile = None,
    view: Annotated[
        bool,
        typer.Option(
            "--view", help="Show the robots in the browser afterwards, so that you can poke the robots."
        ),
    ] = False,
    show: Annotated[
        str | None,
        typer.Option(
            help="Another demo: touch. People poke, pat and guide nao, icub and g1-inspire in the browser; "
            "with --headless it is told in words."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Poke simulated robots. All robots respond with the withdrawal reflex.

    A simulated compliant finger pokes five taxels anywhere on each arm, with the reflex and without the
    reflex; --seed draws others. On a robot without skin on its arms it pokes what else there is: finger pads
    (finger-reflex), or the switches of head and hands (head-stop, soft-hands). The command prints a table of
    measurements, draws the measurements in OUT/demo.png, and writes all numbers to OUT/report.json.

    --fault NAME@TIME pokes one robot once, injects the named fault at this time in seconds, and prints each
    event immediately. --touch and --touches have people touch one robot instead, in the words of tci run, and
    print each event. --via tests a middleware: this process serves the simulated robot in real time, as tci
    serve does, and another process runs the reflex.

    Example:  tci demo nao --out /path/to/folder

    Example:  tci demo --fault stall@0.32

    Example:  tci demo --show touch
    """
    if show is not None:
        if fault or touch or touches or view or via or skin_rate or mode != "position":
            raise CommandError(
                "--show is a demo of its own; valid with it: ROBOTS, --out, --headless, --json"
            )
        from tci.cli.show import play_show

        play_show(show, robot or [], out, headless=headless, as_json=as_json)
        return
    if fault or touch or touches:
        from tci.cli.run import run_capability

        if view or via or skin_rate or mode != "position" or len(robot or ()) > 1:
            raise CommandError(
                "--fault, --touch and --touches are for one robot; valid with them: one ROBOT, --json"
            )
        name = (robot or ["nao"])[0]
        run_capability(
            "withdrawal", name, rehearsal=bool(fault), poke=not (touch or touches), touch=touch or [],
            touches=touches, faults=fault or [], as_json=as_json,
        )  # fmt: skip
        return
    if view:
        from tci.cli.view import needs_viewer

        needs_viewer()
    _run_trials(robot or [], mode, out, seed=seed, headless=headless, skin_rate=skin_rate, via=via,
                as_json=as_json)  # fmt: skip
    if view:
        from tci.cli.view import view as show_page

        show_page(robot, port=0, out=out / "recordings", headless=headless)
    elif not as_json:
        words = (
            f"Next: open {out / 'demo.png'}, then poke robots yourself in the browser: {next_command('demo')}"
        )
        console.print(words, highlight=False, markup=False, soft_wrap=True)


def _run_trials(
    names: Sequence[str],
    mode: str,
    out: Path,
    *,
    seed: int,
    headless: bool,
    skin_rate: float | None,
    via: str | None,
    as_json: bool,
) -> None:
    """Pokes each robot at each place, prints the measurements, and writes a picture and a report into the
    folder `out`.

    Raises UnknownNameError if the reflex does not support the mode, or if a robot's description has no
    binding for the middleware. Raises MissingExtraError or DriverError if no server can be opened.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from tci.capabilities.capability import lacks
    from tci.capabilities.withdrawal import WithdrawalReflex
    from tci.cli.bare import tell_bare
    from tci.drivers.combined_server import JOIN
    from tci.lab.authoring.dense_skin import with_skin_rate
    from tci.lab.experiments.experiment import run_experiment
    from tci.lab.experiments.pictures import draw_demo
    from tci.lab.experiments.remote_trial import try_server
    from tci.lab.experiments.trial_places import trial_count, unanswered

    robots = load_robots(names)
    if via is not None:
        for one, address in product(robots, via.split(JOIN)):
            one.binding(address.partition(":")[0])
        try_server(robots[0], via)
    if skin_rate is not None:
        robots = [with_skin_rate(one, skin_rate) for one in robots]
    reflex = WithdrawalReflex(mode=_mode(mode))
    if out.exists() and not out.is_dir():
        raise CommandError(f"{out} is a file; valid: --out FOLDER, for picture and report")
    out.mkdir(parents=True, exist_ok=True)
    columns = (TextColumn("{task.description:<44}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with told_here(), Progress(*columns, console=console, disable=as_json) as progress:
        total = sum(map(trial_count, robots))
        task = progress.add_task("building the worlds", total=total + 1)

        def advance(trial: Trial) -> None:
            what = f"poked {trial.robot}, {trial.part.replace('_', ' ')}, {trial.site.replace('_', ' ')}"
            progress.update(task, advance=1, description=what)

        report = run_experiment(robots, reflex, seed=seed, via=via, progress=advance)
        progress.update(task, description="drawing the picture")
        picture = out / "demo.png"
        drawn = draw_demo(robots, reflex, picture, seed=seed)
        progress.update(task, advance=1, description="done")
    path = out / "report.json"
    path.write_text(json.dumps(report.to_json(), indent=2, allow_nan=False) + "\n")
    answered = sum(trial.responded for trial in report.trials)
    if as_json:
        print_json(report.to_json())
    else:
        if report.trials:
            console.print(_table(report, mode))
        if report.same_touch:
            console.print(_touches(report.same_touch))
        _summary(report, robots)
        for robot in robots:
            tell_bare(robot)
            _tell_else(robot, report, lacks(reflex, robot), unanswered(robot))
        pictured = f"picture {picture}" if drawn else "no picture: there is no skin to poke"
        console.print(f"{pictured}\nreport  {path}", highlight=False, markup=False)
    if via is not None and report.trials and not answered:
        raise CommandError(
            f"no poke was answered over {via}; to compare, within one process: tci demo "
            f"{' '.join(robot.name for robot in robots)}"
        )
    if as_json:
        return
    screen = sys.stdout.isatty() and (os.environ.get("DISPLAY") or sys.platform != "linux")
    if drawn and screen and not headless:
        typer.launch(str(picture))


def _mode(name: str) -> Mode:
    """Returns the control mode with the name `name`. Raises UnknownNameError if the reflex does not support
    this mode."""
    from tci.capabilities.withdrawal import MODES

    for mode in MODES:
        if mode.value == name:
            return mode
    raise UnknownNameError("mode of the withdrawal reflex", name, [mode.value for mode in MODES])


def _table(report: Report, mode: str) -> Table:
    from rich.table import Table

    table = Table(
        title=f"One reflex on every robot, in {mode} mode: a finger pokes, the arm withdraws",
        caption="A site is a patch and a taxel, drawn anywhere with --seed. Times count from the "
        "first contact. command: first command of the reflex; motion: first "
        "motion of a joint; lost: the finger no longer touches; peak: largest force of the finger; CoP: "
        "error of the centre of pressure; away: distance that the skin withdrew; without: that distance with "
        "the reflex switched off; limits broken: number of limits that a command or a motion exceeded.",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    sites = [trial.site.replace("_", " ") for trial in report.trials]
    table.add_column("site", no_wrap=True)
    for name in ("command\nms", "motion\nms", "lost\nms", "peak\nN", "CoP\nmm", "away\nmm", "without\nmm",
                 "limits\nbroken"):  # fmt: skip
        table.add_column(name, justify="right", overflow="fold")
    begun = ("", "")
    for trial, site in zip(report.trials, sites, strict=True):
        if (trial.robot, trial.part) != begun:
            begun = (trial.robot, trial.part)
            table.add_section()
            other = "" if trial.capability == "withdrawal" else f": {trial.capability}"
            title = f"{trial.robot}, {trial.part.replace('_', ' ')}{other}"
            table.add_row(f"[bold]{fill(title, 2 + max(map(len, sites)))}[/]")
        table.add_row(
            f"  {site}",
            _number(trial.trigger_ms),
            _number(trial.first_motion_ms),
            _number(trial.contact_lost_ms),
            f"{trial.peak_force_n:.1f}",
            _number(trial.cop_error_mm, ".1f"),
            f"{trial.withdrawn_mm:.0f}",
            f"{trial.withdrawn_without_reflex_mm:.1f}",
            f"[red]{trial.limit_violations}[/]" if trial.limit_violations else "[green]0[/]",
        )
    return table


def _touches(same: Sequence[SameTouch]) -> Table:
    """Returns a table that compares the responses of the robots to equal touches: the force and the gain on
    each robot."""
    from rich.table import Table

    table = Table(
        title="The same touch on every skin: perceived force \\[N] and gain of the reflex",
        caption="Medians over places on the left arm. Grey: less than two counts on the coarsest skin.",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=True,
    )
    names = list(dict.fromkeys(row.robot for row in same))
    for head in ("probe\nmm", "pressed\nN", *(f"{name}\nN  gain" for name in names)):
        table.add_column(head, justify="right", no_wrap=True)
    touches: dict[tuple[float, float], list[SameTouch]] = {}
    for row in same:
        touches.setdefault((row.probe_mm, row.pressed_n), []).append(row)
    for (probe, pressed), rows in touches.items():
        table.add_row(
            f"{probe:g}",
            f"{pressed:g}",
            *(
                f"{row.force_n:.2f}  {row.gain:.2f}" if row.force_n or row.heavy else "too light"
                for row in rows
            ),
            style="" if rows[0].heavy else "dim",
        )
    return table


def _tell_else(robot: Robot, report: Report, missing: Sequence[str], unanswered: Sequence[str]) -> None:
    """Tells what was poked of a robot without skin for the reflex, and the skin that nothing answers."""
    own = [trial.capability for trial in report.trials if trial.robot == robot.name]
    others = [name for name in dict.fromkeys(own) if name != "withdrawal"]
    if missing:
        said = f"poked what {robot.name} has: {', '.join(others)}" if others else "skin: docs/add-a-skin.md"
        console.print(
            f"withdrawal: {'; '.join(missing)}; {said}", style="yellow", highlight=False, markup=False
        )
    if unanswered:
        words = f"no capability of TCI answers {', '.join(unanswered)}"
        console.print(words, style="dim", highlight=False, markup=False)


def _number(value: float | None, form: str = ".0f") -> str:
    return "[red]never[/]" if value is None else format(value, form)


def _summary(report: Report, robots: Sequence[Robot]) -> None:
    trials = report.trials
    responded = sum(trial.responded for trial in trials)
    lost = sum(trial.contact_lost_ms is not None for trial in trials)
    others = [name for name in dict.fromkeys(trial.capability for trial in trials) if name != "withdrawal"]
    by = " and ".join(["the reflex"] * any(trial.capability == "withdrawal" for trial in trials) + others)
    what = "skin" if others else "arm"
    console.print(
        f"{responded} of {len(trials)} pokes answered by {by or 'the reflex'}; the {what} left the finger in "
        f"{lost}"
    )
    same, names = report.same_stimulus, [robot.name for robot in robots if robot.name in report.compared]
    if len(names) > 1:
        console.print(
            f"identical touches on {' and '.join(names)}: generic motions differ by "
            f"{same.max_generic_difference_rad:.0e} rad, directions of the hands by at most "
            f"{max(same.hand_direction_deg.values()):.1f} degrees relative to the shoulder, "
            f"{max(same.hand_direction_torso_deg.values()):.1f} degrees relative to the torso"
        )
    for trial in trials:
        for what in (*trial.violations, *trial.halts):
            console.print(f"[red]{trial.robot} {trial.part} {trial.site}: {escape(what)}[/]")
        for why in () if trial.responded else trial.notes:
            console.print(f"{trial.robot} {trial.site}: {escape(why)}", style="yellow", highlight=False)
