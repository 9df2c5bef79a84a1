"""`tci run`: runs a capability on a robot and prints the events of gate and loop as they happen."""

from __future__ import annotations

import contextlib
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from tci.cli import completion
from tci.cli.console import console, print_json, told_here
from tci.cli.options import Arm, AsJson, Duration, Faults, RobotName, Via
from tci.errors import CommandError

if TYPE_CHECKING:
    from rich.live import Live

    from tci.capabilities.capability import Capability
    from tci.drivers.driver import Driver
    from tci.pictures.film import Film
    from tci.recording.recorder import Recorder
    from tci.runtime.loop import Tick
    from tci.runtime.result import RunResult

REHEARSAL = 1.5
"""Shortest run [s] with an injected fault: long enough for one poke and the response."""
FLICKER = 0.4
"""Noise [counts] of the simulated skin in a rehearsal: most rounded values stay, some change by one."""
POKE_DELAY = 0.3
"""Time [s] from the start of the run to the finger's touch. The robot is at rest by then."""


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
    poke: Annotated[
        bool, typer.Option("--poke", help="Poke the left forearm with a simulated finger.")
    ] = False,
    fault: Faults = None,
    record: Annotated[Path | None, typer.Option(help="Record the run to this new file (.mcap).")] = None,
    film: Annotated[
        Path | None,
        typer.Option(
            help="Film a simulated robot in slow motion (3x): .gif, .webp, .png; .mp4 needs the extra video."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a capability on a robot. Prints touches, commands, holds, refusals and clamps as they happen.

    A real robot is only read, unless you give --arm. Exit status 1 when the robot had to stop, or when every
    command was refused.

    Example:  tci run withdrawal nao --duration 1 --poke --fault stall@0.32

    Example:  tci run withdrawal nao --via replay:touch.mcap
    """
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


def run_capability(
    name: str,
    robot: str,
    *,
    via: str = "sim",
    duration: float | None = None,
    arm: bool = False,
    poke: bool = False,
    faults: Sequence[str] = (),
    record: Path | None = None,
    film: Path | None = None,
    as_json: bool = False,
    rehearsal: bool = False,
) -> None:
    """Runs a capability and prints its events. Exit status 1 after a stop, or if every command was refused.

    Args:
        name: Capability by name or MODULE:CLASS.
        robot: Robot by name or description file.
        via: Driver, NAME or NAME:ADDRESS.
        duration: Time [s]; None runs until Ctrl-C.
        arm: Allows a real robot to move.
        poke: Pokes the left forearm with the simulated finger.
        faults: Faults to inject, NAME@TIME or NAME@TIME:DURATION [s].
        record: Recording to write.
        film: Film to write.
        as_json: Prints JSON instead of text.
        rehearsal: Runs as long as the faults need, with noise on the simulated skin as on a real one.

    Raises UnknownNameError, DriverError, CommandError for invalid times of a fault or for a poke of a real
    robot, and the errors of the capability.
    """
    from rich.live import Live

    from tci.cli.record import about_capability, recorder_for, summary
    from tci.cli.run_log import COLOURS, RunLog
    from tci.drivers.faults.fault_injector import FaultInjector, parse_fault
    from tci.drivers.faults.injectors import INJECTORS
    from tci.drivers.registry import HARMLESS, connect
    from tci.drivers.replay import ReplayDriver
    from tci.gate.gate import GateState
    from tci.reasons import OTHERS, Reason, ReasonCounter
    from tci.robot.catalogue import load_robot
    from tci.runtime.arguments import load_capability
    from tci.runtime.loop import run as run_loop
    from tci.runtime.loop_report import LoopReport

    capability = load_capability(name)
    plans = [parse_fault(fault) for fault in faults]
    if rehearsal:
        duration = max(REHEARSAL, *(plan.at + INJECTORS[plan.name].shows_after + 1.0 for plan in plans))
    driver = connect(load_robot(robot), via, arm=arm or via.partition(":")[0] in HARMLESS)
    report = LoopReport()
    result: RunResult[Any] | None = None
    error: BaseException | None = None
    inner = driver
    recorder = None
    with driver, told_here(), contextlib.ExitStack() as closing:
        if record is not None:
            about = about_capability(name, capability)
            recorder = closing.enter_context(recorder_for(record, driver, via, about))
        if poke:
            poke_forearm(driver)
        filmed = _film(inner, film) if film is not None else None
        if plans:
            closing.enter_context(quiet_rehearsals())
            driver = FaultInjector(driver, plans, flicker=FLICKER if rehearsal else 0.0)
        shown: contextlib.AbstractContextManager[Live | None] = (
            contextlib.nullcontext()
            if as_json
            else Live(console=console, refresh_per_second=10, transient=True)
        )
        with shown as live:
            teller = RunLog(driver, report, live)

            def see(tick: Tick) -> None:
                if recorder is not None:
                    recorder.tick(tick.now, tick.reading, tick.commands, tick.sent)
                if filmed is not None:
                    filmed.see(tick)
                teller.see(tick)

            heard = ReasonCounter()

            def listen(memory: Any) -> bool:
                for note in capability.notes(memory):
                    if heard.add(Reason.of(note), driver.clock.now()):
                        teller.tell(driver.clock.now(), "NOTE", note, "yellow")
                return False

            try:
                result = run_loop(
                    driver, capability, duration=duration, observe=see, until=listen, report=report
                )
            except (Exception, KeyboardInterrupt, SystemExit) as failure:
                if not report.ended:  # it never began
                    raise
                error = failure
                now = driver.clock.now()
                teller.tell_faults(now)
                rest = "; the robot was brought to rest" if driver.armed else ""
                words = f"{report.ended}{_place(failure, capability)}{rest}"
                teller.worst = GateState.STOP
                teller.tell(now, "STOP", words, COLOURS[GateState.STOP])
            if result is not None and result.refused_all:
                words = "every command was refused, so the capability moved nothing"
                teller.tell(driver.clock.now(), "refused", words, "bold red")
            if report.cut_short:
                words = "the run ended during a motion; a hold stopped it"
                teller.tell(driver.clock.now(), "at rest", words, "dim")
            if heard.counts[OTHERS]:
                teller.tell(driver.clock.now(), "NOTE", "further notes are not shown", "yellow")
    if filmed is not None:
        filmed.save()
    counts = driver.gate.counts
    told: dict[str, Any] = {
        "state": driver.gate.state.value,
        "worst": teller.worst.value,
        "events": teller.events,
        "refusals": [notice.to_json() for notice in teller.refused.notices()],
        "clamps": [notice.to_json() for notice in teller.clamped.notices()],
        "faults": teller.outcome(),
        "gate": {"holds": counts.holds, "stops": counts.stops, "refusals": counts.refusals,
                 "clamps": dict(counts.clamps), "near_misses": counts.near_misses},
        "loop": report.to_json(),
    }  # fmt: skip
    if result is not None:
        told |= {"touched_N": dict(result.touched), "moved_rad": dict(result.moved)}
    if recorder is not None:
        told["recording"] = summary(recorder)
    if isinstance(inner, ReplayDriver):
        told["replay"] = {
            "compared": inner.compared, "different": len(inner.different), "other_versions": inner.changed,
        }  # fmt: skip
    if as_json:
        print_json(told)
    else:
        teller.conclude()
        if result is not None:
            console.print(result.summary, highlight=False, markup=False)
        console.print(
            f"{report.ticks} periods, {report.overruns} overruns ({report.missed} periods missed); "
            f"computing time p50 {report.work.quantile(0.5) * 1e3:.2f}, "
            f"p99.9 {report.work.quantile(0.999) * 1e3:.2f} ms; "
            f"gate: {counts.holds} holds, {counts.stops} stops, {counts.refusals} refusals; "
            f"state at the end: [{COLOURS[driver.gate.state]}]{driver.gate.state.name}[/]",
            highlight=False,
        )
        for line in _said(recorder, inner):
            console.print(line, highlight=False)
    if isinstance(error, SystemExit | KeyboardInterrupt):
        raise SystemExit(error.code if isinstance(error, SystemExit) else 130)
    if teller.worst is GateState.STOP or not result:
        raise SystemExit(1)


def _place(error: BaseException, capability: Capability[Any]) -> str:
    """Returns the file and line of an error in the capability's own file; empty for an error elsewhere."""
    file = sys.modules[type(capability).__module__].__file__
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return f" ({Path(str(file)).name}, line {lines[-1]})" if lines else ""


@contextlib.contextmanager
def quiet_rehearsals() -> Iterator[None]:
    """Suppresses the traceback of a thread that an injected fault ends on purpose."""
    from tci.drivers.faults.injectors import THREAD

    usual = threading.excepthook

    def hook(told: threading.ExceptHookArgs) -> None:
        if told.thread is None or told.thread.name != THREAD:
            usual(told)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = usual


def _said(recorder: Recorder | None, driver: Driver) -> list[str]:
    """Returns the lines to print about the recording that was written and the one that was replayed."""
    from tci.drivers.replay import ReplayDriver

    lines = []
    if recorder is not None:
        end = f"[red]{escape(recorder.failed)}[/]" if recorder.failed else "complete"
        lines.append(f"recording {escape(str(recorder.path))}: {recorder.ticks} periods, {end}")
    if isinstance(driver, ReplayDriver):
        same = "all identical, bit for bit" if not driver.different else (
            f"[yellow]{len(driver.different)} differ, first at {driver.different[0]:.3f} s[/]")  # fmt: skip
        same = same if driver.compared else "the recording has none"
        lines.append(f"replay: {driver.compared} decisions of the gate compared: {same}")
        if driver.different and driver.changed:
            lines.append(escape(f"it was recorded with other versions: {'; '.join(driver.changed)}"))
    return lines


def _film(driver: Driver, path: Path) -> Film:
    """Begins a film of a simulated left arm. Raises CommandError for a real robot."""
    from tci.capabilities.fields import default_fields
    from tci.drivers.simulated import SimulatedDriver
    from tci.pictures.film import Film

    if not isinstance(driver, SimulatedDriver):
        raise CommandError("--film needs a simulated robot; valid: --via sim")
    return Film(driver.world, path, fields=default_fields(), part="left_arm")


def poke_forearm(driver: Driver) -> None:
    """Pokes the left forearm with the simulated finger. Raises CommandError for a real robot."""
    from tci.body.places import find_place
    from tci.capabilities.fields import default_fields
    from tci.drivers.simulated import SimulatedDriver
    from tci.skin.skin import Skin

    if not isinstance(driver, SimulatedDriver):
        raise CommandError("--poke needs a simulated robot; valid: --via sim")
    site = default_fields()[0]
    joints = driver.read().joints
    place = find_place(Skin(driver.robot), "left_arm", site.segment, site.u, site.theta, joints)
    speed = 0.25
    driver.world.finger.poke(
        place.patch, place.p_L, place.n_L, speed=speed, depth=0.01, gap=speed * POKE_DELAY
    )
