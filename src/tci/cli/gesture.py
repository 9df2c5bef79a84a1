"""`tci gesture`: records a gesture on one robot, and plays the gesture on any other robot."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tci.cli.options import Arm, AsJson, Duration, NewGesture, RobotName, Via
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.gestures.bvh import Imported
    from tci.gestures.gesture import Fitted, Gesture
    from tci.lab.experiments.follow import Following
    from tci.messages.frames import Array
    from tci.robot.description import Robot

TOLD = 250
"""Length [characters] of the longest sentence about an imported file. Assumed: three lines of a terminal."""
app = typer.Typer(
    help="Record a gesture on one robot, and play the gesture on another robot.", no_args_is_help=True
)


@app.command()
def record(
    file: NewGesture,
    robot: RobotName,
    via: Via = "sim",
    duration: Duration = None,
    as_json: AsJson = False,
) -> None:
    """Record the posture of a robot while a person moves the robot, for at most one hour. TCI sends no
    commands.

    Example:  tci gesture record wave.csv nao --via replay:wave.mcap
    """
    from contextlib import suppress

    import numpy as np

    from tci.cli.console import console, print_json
    from tci.drivers.registry import connect
    from tci.gestures.files import write_csv
    from tci.gestures.gesture import LONGEST, SAMPLE, record
    from tci.robot.catalogue import load_robot
    from tci.runtime.control import Control

    writable(file)
    words = load_robot(robot)
    times: list[float] = []
    positions: list[Array] = []

    def write() -> Gesture:
        gesture = record(words, np.array(times), np.array(positions))
        write_csv(gesture, file, {part.name: [joint.name for joint in part.servos] for part in words.parts})
        return gesture

    try:
        with connect(words, via, arm=False) as driver, suppress(KeyboardInterrupt):
            for moment in Control(driver, write=False).periods(duration=duration):
                now, joints = moment.now, moment.reading.joints
                if times and now - times[0] > LONGEST:
                    break
                due = not times or now - times[-1] >= SAMPLE - 1e-9
                if due and np.isfinite(joints.position).all():
                    times.append(now)
                    positions.append(joints.position)
    except Exception:
        if len(times) >= 2:
            write()
            typer.echo(f"tci: {file} has the {len(times)} postures before the error", err=True)
        raise
    if len(times) < 2:
        raise CommandError(
            f"{robot} sent {len(times)} postures, too few for a gesture; valid: 2 or more, record longer"
        )
    gesture = write()
    report = {"file": str(file), "postures": len(times), "duration_s": gesture.duration,
            "parts": list(gesture.postures)}  # fmt: skip
    if as_json:
        print_json(report)
    else:
        console.print(
            f"{file}: {len(times)} postures of {', '.join(gesture.postures)} in {gesture.duration:.1f} s",
            highlight=False,
            markup=False,
        )


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(help="File of motion capture (.bvh) or a gesture (.csv).")],
    target: NewGesture,
    as_json: AsJson = False,
) -> None:
    """Convert a file of motion capture (.bvh) to a gesture (.csv).

    Example:  tci gesture convert wave.bvh wave.csv
    """
    from tci.cli.console import console, print_json
    from tci.gestures.files import write_csv

    writable(target)
    imported = load(source)
    gesture = imported.gesture
    write_csv(gesture, target, imported.names)
    if as_json:
        print_json({"file": str(target), "duration_s": gesture.duration, "parts": list(gesture.postures),
                    "used": list(imported.used), "left_out": list(imported.left_out)})  # fmt: skip
        return
    words = f"{target}: {', '.join(gesture.postures)}, {gesture.duration:.1f} s"
    console.print(words, highlight=False, markup=False)
    _tell(imported)


@app.command()
def field(
    source: Annotated[
        Path,
        typer.Argument(help="Motion of a person who is touched: motion capture (.bvh) or a gesture (.csv)."),
    ],
    target: Annotated[Path, typer.Argument(help="File of receptive fields (.toml): made, or added to.")],
    place: Annotated[str, typer.Option(help="Where the person was touched: 'left forearm outside'.")],
    at: Annotated[
        float | None, typer.Option(help="Time of the touch \\[s]. \\[default: where the arm begins to move]")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="Name of the field. \\[default: the words of the place without side]")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Learn a receptive field from a person who is touched: the place of the touch, and the motion of the arm
    from then to where the hand is farthest away.

    Example:  tci gesture field poked.bvh people.toml --place "left forearm outside" --at 1.2
    """
    from tci.cli.console import console, print_json
    from tci.lab.authoring.learn_field import add_field, learn_field
    from tci.robot.generic_arm import JOINTS

    if target.suffix.lower() != ".toml" or not target.parent.is_dir():
        raise CommandError(f"{target} can't hold fields; valid: a .toml file in a folder that exists")
    imported = load(source)
    plain = re.sub(r"[^a-z0-9]+", "_", re.sub(r"^(left|right) ", "", place.lower())).strip("_")
    learnt = learn_field(imported.gesture, place, name or plain, at=at)
    count = add_field(learnt.field, target)
    motion = {joint: round(math.degrees(angle), 1)
              for joint, angle in zip(JOINTS, learnt.field.motion, strict=True)}  # fmt: skip
    if as_json:
        print_json({"file": str(target), "field": learnt.field.name, "fields": count, "motion_deg": motion,
                    "from_s": learnt.start, "to_s": learnt.end, "used": list(imported.used),
                    "left_out": list(imported.left_out)})  # fmt: skip
        return
    words = ", ".join(f"{joint} {angle:+.0f}" for joint, angle in motion.items())
    console.print(
        f"{target}: {count} field{'s' if count > 1 else ''}; {learnt.field.name}: the {learnt.side} arm from "
        f"{learnt.start:.2f} to {learnt.end:.2f} s turned by {words} degrees", highlight=False, markup=False,
    )  # fmt: skip
    _tell(imported)


@app.command()
def play(
    file: Annotated[Path, typer.Argument(help="Gesture (.csv) or file of motion capture (.bvh).")],
    robot: RobotName,
    via: Via = "sim",
    plain: Annotated[
        bool,
        typer.Option(
            "--plain",
            help="Send the generic angles without changes. \\[default: solve for exact directions of the "
            "limbs]",
        ),
    ] = False,
    reflex: Annotated[
        bool, typer.Option("--reflex", help="Let the withdrawal reflex interrupt the gesture.")
    ] = False,
    arm: Arm = False,
    as_json: AsJson = False,
) -> None:
    """Play a gesture, and print the errors of the robot's joints.

    The gesture has its recorded speed, or is slower if the robot's limits require it.

    The exit status is 1 if the robot did not reach the end of the gesture.

    Example:  tci gesture play wave.csv icub --reflex
    """
    from tci.capabilities.play_gesture import Phase, PlayGesture
    from tci.capabilities.withdrawal import WithdrawalReflex
    from tci.cli.console import console, print_json
    from tci.drivers.info import moves_nothing_real
    from tci.drivers.registry import connect
    from tci.gestures.gesture import fit
    from tci.lab.experiments.follow import follow
    from tci.robot.catalogue import load_robot

    words = load_robot(robot)
    imported = load(file)
    gesture = imported.gesture
    fitted = fit(words, gesture, exact=not plain)
    if not as_json:
        _announce(words, gesture, fitted)
        _tell(imported)
    driver = connect(words, via, arm=arm or moves_nothing_real(via))
    with driver:
        following = follow(driver, PlayGesture(fitted), reflexes=[WithdrawalReflex()] if reflex else [])
    done = following.phase is Phase.DONE
    if as_json:
        print_json({"done": done, **following.to_json(), "slower": fitted.slower,
                    "missed_rad": dict(fitted.missed), "used": list(imported.used),
                    "left_out": [*imported.left_out, *fitted.left_out]})  # fmt: skip
    else:
        console.print(_table(fitted, following))
        if following.stopped:
            console.print(
                "[yellow]the gate stopped motions that came too close to the robot's own body: "
                f"{', '.join(following.stopped)}[/]",
                highlight=False,
            )
        again = f", interrupted {following.interruptions} times" if following.interruptions else ""
        console.print(f"played in {following.duration:.1f} s{again}", highlight=False)
    if not done:
        raise SystemExit(1)


def writable(path: Path) -> None:
    """Raises CommandError if a gesture can't be written to `path`. Called before a person moves the robot, so
    that no motion is lost."""
    if path.suffix.lower() != ".csv" or not path.parent.is_dir():
        raise CommandError(f"{path} can't hold a gesture; valid: a .csv file in a folder that exists")
    if path.exists():
        raise CommandError(f"{path} exists and is not replaced; valid: a new file name")


def load(path: Path) -> Imported:
    """Reads a gesture (.csv) or a file of motion capture (.bvh).

    Raises CommandError if the file has another ending, and DescriptionError if the file can't be read.
    """
    from tci.gestures.bvh import Imported, read_bvh
    from tci.gestures.files import read_csv

    kind = path.suffix.lower()
    if kind == ".csv":
        gesture, names = read_csv(path)
        return Imported(gesture, names, (f"all {sum(map(len, names.values()))} columns of angles",), ())
    if kind == ".bvh":
        return read_bvh(path)
    raise CommandError(f"{path} is no gesture; valid: a .csv or a .bvh file")


def _tell(imported: Imported) -> None:
    """Prints what became of the file. Lists of tens of joints are cut off; `--json` has them whole."""
    from tci.cli.console import console

    for title, what in (("used", imported.used), ("left out", imported.left_out)):
        for words in what:
            begin = (
                words if len(words) <= TOLD else f"{words[: words.rfind(', ', 0, TOLD)]}, ... (all: --json)"
            )
            console.print(f"  {title}: {begin}", highlight=False, markup=False)


def _announce(robot: Robot, gesture: Gesture, fitted: Fitted) -> None:
    from tci.cli.console import console

    console.print(
        f"{robot.name}: {', '.join(fitted.gesture.postures)} in {fitted.gesture.duration:.1f} s, "
        f"{fitted.slower:.2f} times as long as recorded ({gesture.duration:.1f} s)",
        highlight=False,
    )
    for part in fitted.left_out:
        console.print(
            f"  note: {robot.name} has no {part}; its motion is left out", style="yellow", highlight=False
        )


def _table(fitted: Fitted, following: Following) -> object:
    import numpy as np
    from rich import box
    from rich.table import Table

    table = Table(title="Errors \\[degrees]", box=box.SIMPLE_HEAD)
    table.add_column("joint", no_wrap=True, overflow="fold")
    for column in ("cut off by limits", "following, RMS", "following, largest"):
        table.add_column(column, justify="right")
    for name in dict.fromkeys((*following.rms, *fitted.missed)):
        values = (fitted.missed.get(name, 0.0), following.rms.get(name), following.largest.get(name))
        table.add_row(name, *("" if v is None else f"{np.rad2deg(v):.2f}" for v in values))
    return table
