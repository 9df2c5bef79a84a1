"""`tci run`: runs a capability on a robot, and immediately prints the events of the gate and the loop."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from tci.cli import completion
from tci.cli.console import console, print_json, told_here
from tci.cli.options import Arm, AsJson, Duration, Faults, RobotName, Task, Touches, TouchFile, Via
from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.drivers.driver import Driver
    from tci.lab.pictures.film import Film
    from tci.runtime.loop import Tick


def run(
    capability: Annotated[
        str,
        typer.Argument(
            help="Capability: a name such as withdrawal, MODULE:CLASS, a policy (.onnx), or "
            "fields of the reflex (.toml).",
            autocompletion=completion.capabilities,
        ),
    ],
    robot: RobotName,
    via: Via = "sim",
    duration: Duration = None,
    arm: Arm = False,
    poke: Annotated[
        bool,
        typer.Option("--poke", help="Poke a simulated robot: the skin that the capability needs."),
    ] = False,
    touch: Touches = None,
    touches: TouchFile = None,
    fault: Faults = None,
    record: Annotated[Path | None, typer.Option(help="Record the run in this new file (.mcap).")] = None,
    task: Task = None,
    film: Annotated[
        Path | None,
        typer.Option(
            help="Film a simulated robot in slow motion (3x), as .gif, .webp, .png or .mp4 (needs the "
            "extra video)."
        ),
    ] = None,
    lesson: Annotated[
        Path | None,
        typer.Option(help="With teach: write the motion that was taught to this new gesture (.csv)."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a capability on a robot. Prints touches, commands, holds, refusals and clamps immediately. A real
    robot moves only with --arm. Without --arm, TCI only reads the robot's data. The exit status is 1 if the
    gate stopped the robot, if it refused every command, if a finger or hand did not touch, or if --lesson
    got none. While it runs, type reset or free.

    Example:  tci run withdrawal nao --duration 1 --poke --fault stall@0.32

    Example:  tci run withdrawal icub --touch "stroke 'left forearm' 3N 8cm/s"

    Example:  tci run withdrawal nao --via replay:touch.mcap
    """
    run_capability(
        capability,
        robot,
        via=via,
        duration=duration,
        arm=arm,
        poke=poke,
        touch=touch or [],
        touches=touches,
        faults=fault or [],
        record=record,
        task=task,
        film=film,
        lesson=lesson,
        as_json=as_json,
    )


def run_capability(
    name: str,
    robot: str,
    *,
    via: str = "sim",
    duration: float | None = None,
    arm: bool = False,
    poke: bool = False,
    touch: Sequence[str] = (),
    touches: Path | None = None,
    faults: Sequence[str] = (),
    record: Path | None = None,
    task: str | None = None,
    film: Path | None = None,
    lesson: Path | None = None,
    as_json: bool = False,
    rehearsal: bool = False,
) -> None:
    """Runs a capability and prints the events. Exits with status 1 if the gate stopped the robot or refused
    every command, or if the finger or a hand did not touch.

    Args:
        name: Name of the capability, MODULE:CLASS, or the path of a policy (.onnx) or of fields (.toml).
        robot: Name of the robot, or path of a description file.
        via: Driver, NAME or NAME:ADDRESS.
        duration: Duration [s] of the run; None runs until Ctrl-C.
        arm: True to allow a real robot to move.
        poke: True to poke with the simulated finger (`session.poke_skin`).
        touch: Touches of people, each a line of words (`tci.touches.parse_touch`).
        touches: File with a sequence of touches.
        faults: Faults to inject, NAME@TIME or NAME@TIME:DURATION [s].
        record: Path of the recording to write; None for no recording.
        task: What the recording shows, for data sets.
        film: Path of the film to write; None for no film.
        lesson: Path of the gesture to write that was taught by touch; None for none.
        as_json: True to print JSON instead of text.
        rehearsal: True to run until the injected faults have ended, with realistic noise on the simulated
            skin.

    Raises UnknownNameError for an unknown name, DriverError if the connection fails, CommandError for invalid
    times of a fault or for a poke of a real robot, and the errors of the capability.
    """
    from tci.capabilities.capability import lacks
    from tci.cli import session as sessions
    from tci.cli.bare import tell_bare, tell_lacks
    from tci.cli.lesson import expect_lesson, save_lesson
    from tci.cli.operator import Operator
    from tci.cli.run_view import RunView, conclude
    from tci.cli.touching import ask
    from tci.drivers.info import moves_nothing_real
    from tci.drivers.registry import connect
    from tci.lab.faults.fault_injector import parse_fault
    from tci.robot.catalogue import load_robot
    from tci.runtime.arguments import load_capability

    if task is not None and record is None:
        raise CommandError("--task is the text of a recording; valid: with --record FILE")
    capability = load_capability(name)
    if lesson is not None:
        expect_lesson(capability, lesson)
    plans = [parse_fault(fault) for fault in faults]
    if rehearsal:
        duration = sessions.rehearsal_length(plans)
    described = load_robot(robot)
    asked = ask(described, touch, touches)
    options = {} if asked is None else asked.options(via)
    if via == "sim" and (posture := sessions.hanging(capability, described)):
        options = {**options, "posture": posture}
    driver = connect(described, via, arm=arm or moves_nothing_real(via), **options)
    view = RunView(quiet=as_json)
    with driver, told_here(), ExitStack() as closing:
        recorder = None
        if record is not None:
            about = sessions.about_capability(name, capability)
            recorder = closing.enter_context(sessions.recorder_for(record, driver, via, about, task=task))
        missing = lacks(capability, driver.robot)
        if missing and not as_json:
            tell_lacks(name, missing, driver.robot)
        by_finger = poked = ""
        if poke:
            by_finger = poked = sessions.poke_skin(driver, capability)
            if poked and not as_json:
                needed = sessions.skin_needed(capability, driver.robot)
                why = f": it reaches no skin that {name} needs" if needed and poked not in needed else ""
                console.print(f"the simulated finger pokes {poked}{why}", style="dim")
        if asked is not None:
            asked.begin(driver)
            poked = asked.planned[0].patch
            duration = asked.end if duration is None else max(duration, asked.end if rehearsal else 0.0)
            if not as_json:
                asked.tell()
        if (poke or asked is not None) and not as_json:
            tell_bare(driver.robot)
        filmed = _film(driver, film, poked, quiet=as_json) if film is not None else None

        operator = Operator(driver.gate)

        def see(tick: Tick) -> None:
            for words in operator.listen():
                session.log.write(tick.now, "OPERATOR", words)
            view.tick(tick, session)
            if filmed is not None:
                filmed.see(tick)

        if duration is None and not as_json:
            end = "the end of the recording" if via.startswith("replay:") else "Ctrl-C"
            console.print(f"runs until {end}; --duration SECONDS ends it earlier", style="dim")
        session = sessions.Session(
            driver, capability, faults=plans, flicker=sessions.FLICKER if rehearsal else 0.0,
            recorder=recorder, listen=view.event, observe=see,
        )  # fmt: skip
        with view.shown():
            session.run(duration)
    if filmed is not None:
        pictures = filmed.save()
        if not as_json:
            console.print(f"film {film}: {pictures} pictures", highlight=False, markup=False)
    taught = None if lesson is None else save_lesson(session.memory, driver.robot, lesson)
    missed = [] if asked is None else asked.not_done(driver)
    if poke:
        missed += sessions.not_poked(driver, by_finger)
    if as_json:
        touched = ({} if asked is None else asked.to_json(driver)) | {"missed_touches": missed}
        saved = {} if lesson is None else {"lesson_s": None if taught is None else taught.duration}
        print_json(session.to_json() | touched | saved)
    else:
        conclude(session, filmed=filmed is not None)
        if lesson is not None:
            if taught is None:
                words = "not written: no lesson was ended; valid: guide an arm, then tap another part"
            else:
                words = f"{', '.join(taught.postures)}, {taught.duration:.1f} s; "
                words += f"next: tci gesture play {lesson} icub"
            console.print(f"{lesson}: {words}", highlight=False, markup=False)
        result = session.result
        noted = any(event.kind == "NOTE" for event in session.log.events)
        if (
            result is not None
            and result.touched
            and not (missing or noted or result.accepted or result.refusals)
        ):
            console.print(
                f"{name} gave no command: it does not respond to this touch; to touch other places: "
                f"tci view {robot} --run {name}",
                style="yellow",
                highlight=False,
            )
    if isinstance(session.error, SystemExit | KeyboardInterrupt):
        raise SystemExit(session.error.code if isinstance(session.error, SystemExit) else 130)
    for words in () if as_json else missed:
        console.print(words, style="yellow", highlight=False, markup=False)
    if session.failed or missed or (lesson is not None and taught is None):
        raise SystemExit(1)


def _film(driver: Driver, path: Path, patch: str, *, quiet: bool) -> Film:
    """Starts to film the part with the poked `patch`, by default the left arm, of a simulated robot. Unless
    `quiet`, prints how long the drawing takes. Raises CommandError if the robot is not simulated."""
    from tci.capabilities.fields import default_fields
    from tci.drivers.simulated import SimulatedDriver
    from tci.lab.pictures.film import EVERY, Film

    if not isinstance(driver, SimulatedDriver):
        raise CommandError("--film needs a simulated robot; valid: --via sim")
    if not quiet:
        console.print(
            f"the film has {round(1.0 / EVERY)} pictures per second of the run, each in 1 to 3 s of drawing",
            style="dim",
        )
    robot = driver.robot
    arms = [part.name for part in robot.parts if part.kind == "arm"] or [robot.parts[0].name]
    part = robot.patch(patch).part if patch else arms[0]
    return Film(driver.world, path, fields=default_fields(), part=part)
