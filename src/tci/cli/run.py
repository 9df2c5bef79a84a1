"""`tci run`: a capability on a robot, with what gate and loop do told as it happens."""

from __future__ import annotations

import contextlib
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.metadata import entry_points
from inspect import isabstract
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.live import Live
from rich.markup import escape

from tci.body.places import find_place
from tci.capabilities.capability import Capability
from tci.capabilities.fields import default_fields
from tci.cli.console import console, print_json, told_here
from tci.cli.record import about_capability, recorder_for, summary
from tci.cli.run_log import COLOURS, RunLog
from tci.drivers.driver import Driver
from tci.drivers.faults.fault_injector import FaultInjector, parse_fault
from tci.drivers.faults.injectors import INJECTORS, THREAD
from tci.drivers.registry import connect
from tci.drivers.replay import ReplayDriver
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, UnknownNameError
from tci.gate.gate import GateState
from tci.reasons import OTHERS, Reason, ReasonCounter
from tci.recording.recorder import Recorder
from tci.robot.catalogue import load_robot
from tci.runtime.arguments import as_capability
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport
from tci.runtime.result import RunResult
from tci.skin.skin import Skin

if TYPE_CHECKING:
    from tci.pictures.film import Film

GROUP = "tci.capabilities"
HARMLESS = ("sim", "replay")
"""Links behind which nothing moves; they are armed without being asked."""
REHEARSAL = 1.5
"""Least length [s] of a rehearsal: one poke and its answer."""
FLICKER = 0.4
"""Counts by which simulated skin flickers in a rehearsal: most values stay, some change by one."""
POKE_DELAY = 0.3
"""Time [s] from the start to the finger's touch."""


def load_capability(name: str) -> Capability[Any]:
    """A capability with its default settings: by its entry point, or MODULE:CLASS, from here too.

    Raises UnknownNameError for a name that nobody has, CommandError for a class that is none, TciError for
    one that can't be made as it is.
    """
    points = {point.name: point for point in entry_points(group=GROUP)}
    if name in points:
        found = points[name].load()
    elif ":" in name:
        found = _from_module(*name.split(":", 1))
    else:
        raise UnknownNameError("capability", name, [*sorted(points), "or MODULE:CLASS"])
    if not (isinstance(found, type) and issubclass(found, Capability)):
        raise CommandError(f"{name} is no capability; valid: a subclass of tci.Capability")
    return as_capability(found)


def _from_module(module: str, name: str) -> object:
    """What a module has by that name; the module may be in this folder."""
    sys.path.insert(0, "")
    try:
        if module.startswith("."):  # to Python the name of a neighbour, and nobody asks from inside a package
            raise ImportError("a path is no module")
        found = import_module(module)
    except (ImportError, ValueError) as error:
        raise CommandError(f"{module}:{name}: {error}; valid: MODULE:CLASS, as in my_file:Shrug") from error
    if not hasattr(found, name):
        words = dict.fromkeys([*vars(found), *dir(found)])  # a package may load its names on first use
        own = [word for word in words if _can_run(getattr(found, word, None))]
        raise UnknownNameError(f"capability in {module}", name, own)
    return getattr(found, name)


def _can_run(one: object) -> bool:
    """Tells if it is the class of a capability."""
    return isinstance(one, type) and issubclass(one, Capability) and not isabstract(one)


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
    """Run, tell, and exit with status 1 when the gate has stopped or has refused every command.

    A `rehearsal` is as long as its faults need, and the simulated skin flickers as a real one does.

    Raises UnknownNameError, DriverError, CommandError for a fault's times or a poke that can't be, and what
    the capability raises.
    """
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
                result = run(driver, capability, duration=duration, observe=see, until=listen, report=report)
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
                words = "every command was refused: the capability moved nothing"
                teller.tell(driver.clock.now(), "refused", words, "bold red")
            if report.cut_short:
                words = "the run has ended: motions that were not over were cut short by a hold"
                teller.tell(driver.clock.now(), "at rest", words, "dim")
            if heard.counts[OTHERS]:
                teller.tell(driver.clock.now(), "NOTE", "further notes were left out", "yellow")
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
            f"{report.ticks} periods, {report.overruns} overruns ({report.missed} missed); "
            f"work p50 {report.work.quantile(0.5) * 1e3:.2f}, "
            f"p99.9 {report.work.quantile(0.999) * 1e3:.2f} ms; "
            f"gate: {counts.holds} holds, {counts.stops} stops, {counts.refusals} refusals; "
            f"at the end [{COLOURS[driver.gate.state]}]{driver.gate.state.name}[/]",
            highlight=False,
        )
        for line in _said(recorder, inner):
            console.print(line, highlight=False)
    if isinstance(error, SystemExit | KeyboardInterrupt):
        raise SystemExit(error.code if isinstance(error, SystemExit) else 130)
    if teller.worst is GateState.STOP or not result:
        raise SystemExit(1)


def _place(error: BaseException, capability: Capability[Any]) -> str:
    """Where an error arose in the file that the capability is from; empty when it was elsewhere."""
    file = sys.modules[type(capability).__module__].__file__
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == file]
    return f" ({Path(str(file)).name}, line {lines[-1]})" if lines else ""


@contextlib.contextmanager
def quiet_rehearsals() -> Iterator[None]:
    """A thread that fails on purpose leaves no traceback: what came of it is told."""
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
    """What is to be said of a recording made, and of one replayed."""
    lines = []
    if recorder is not None:
        end = f"[red]{escape(recorder.failed)}[/]" if recorder.failed else "closed"
        lines.append(f"recording {escape(str(recorder.path))}: {recorder.ticks} periods, {end}")
    if isinstance(driver, ReplayDriver):
        same = "the same, bit for bit" if not driver.different else (
            f"[yellow]{len(driver.different)} differ, first at {driver.different[0]:.3f} s[/]")  # fmt: skip
        same = same if driver.compared else "none was recorded"
        lines.append(f"replay: {driver.compared} decisions compared: {same}")
        if driver.different and driver.changed:
            lines.append(escape(f"recorded with other versions: {'; '.join(driver.changed)}"))
    return lines


def _film(driver: Driver, path: Path) -> Film:
    """A film of a simulated arm. Raises CommandError for a real robot."""
    from tci.pictures.film import Film

    if not isinstance(driver, SimulatedDriver):
        raise CommandError("--film needs a simulated robot; valid: --via sim")
    return Film(driver.world, path, fields=default_fields(), part="left_arm")


def poke_forearm(driver: Driver) -> None:
    """Let the simulated finger poke the left forearm. Raises CommandError for a real robot."""
    if not isinstance(driver, SimulatedDriver):
        raise CommandError("--poke needs a simulated robot; valid: --via sim")
    site = default_fields()[0]
    joints = driver.read().joints
    place = find_place(Skin(driver.robot), "left_arm", site.segment, site.u, site.theta, joints)
    speed = 0.25
    driver.world.finger.poke(
        place.patch, place.p_L, place.n_L, speed=speed, depth=0.01, gap=speed * POKE_DELAY
    )
