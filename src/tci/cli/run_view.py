"""Shows a run on the terminal: one line for each event, and below these lines one line with the current
state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace

from rich.console import RenderableType
from rich.live import Live
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from tci.cli.console import console
from tci.cli.repeats import Repeats
from tci.cli.run_log import Event
from tci.cli.session import Session
from tci.drivers.replay import ReplayDriver
from tci.gate.gate import GateState
from tci.lab.faults.injectors import INJECTORS
from tci.messages.clock import MonotonicClock
from tci.runtime.loop import Tick
from tci.runtime.result import MET

COLOURS = {
    "RUN": "green", "HOLD": "yellow", "STOP": "bold red", "touch": "blue", "command": "cyan",
    "at rest": "dim", "FAULT": "magenta", "over": "magenta",
}  # fmt: skip
"""Colour of each kind of event. Events of all other kinds are yellow."""
MISSED = 0.01
"""Share of missed periods above which the machine counts as too slow. Assumed: an idle one misses none."""


class RunView:
    """View of a run on the terminal: of each cause at most one line a second. With `quiet`, the view prints
    nothing."""

    def __init__(self, *, quiet: bool) -> None:
        self._live = None if quiet else Live(console=console, refresh_per_second=10, transient=True)
        self._repeats = Repeats(_print)
        self._zero: float | None = None

    @contextmanager
    def shown(self) -> Iterator[None]:
        """Shows the line with the current state inside the `with` block."""
        with self._live or nullcontext():
            yield
        self._repeats.end()

    def event(self, event: Event) -> None:
        """Prints one event, or counts it if its cause was printed within the last second."""
        if self._live is not None:
            self._repeats.add(replace(event, now=self._since(event.now)))

    def tick(self, tick: Tick, session: Session) -> None:
        """Updates the line with the current state."""
        if self._live is None:
            return
        now = self._since(tick.now)
        self._repeats.pass_time(now)
        line = Text(f"{now:8.3f} s  ")
        line.append(f" {tick.sent.state.name} ", style=f"reverse {_colour(tick.sent.state.name)}")
        counts = session.driver.gate.counts
        line.append(
            f"  contacts {len(tick.perception.contacts)}  clamps {sum(counts.clamps.values())}  "
            f"refusals {counts.refusals}  overruns {session.report.overruns}"
        )
        self._live.update(line)

    def _since(self, now: float) -> float:
        """Time [s] since the run began: a real robot's clock begins anywhere."""
        self._zero = now if self._zero is None else self._zero
        return now - self._zero


def conclude(session: Session, *, filmed: bool) -> None:
    """Prints the summary of a run: repeated refusals and clamps, the outcome of each injected fault, and the
    statistics. `filmed` is True if a film was made; the computing time then includes the time for its
    pictures."""
    log = session.log
    for kind, reasons in (("refused", log.refused), ("clamped", log.clamped), ("CONTACT", log.went_back)):
        for notice in reasons.notices():
            if notice.count > 1:
                console.print(_row("", kind, str(notice), "yellow"))
    for one in session.log.outcome():
        shows = INJECTORS[one["fault"]].shows_after
        if one["answer"]:
            after = one["after_s"]
            late = f"{after * 1e3:.0f} ms" if after < 1.0 else f"{after:.1f} s"
            words = f"{one['answer']} {late} after {one['fault']}: {one['why']}"
        elif shows:
            words = (
                f"{one['fault']}: the gate did not react. It detects this fault {shows:g} s after its "
                f"begin, on skin that it has read for some seconds; try {one['fault']}@5"
            )
        else:
            words = f"{one['fault']}: the gate had no reason to hold"
        console.print(_row("", "outcome", f"{words}; expected: {one['expected']}", "bold"))
    if session.result is not None:
        console.print(session.result.summary, highlight=False, markup=False)
        for line in (*session.result.unfelt, *session.result.advice):
            console.print(line, highlight=False, markup=False)
    report, counts, state = session.report, session.driver.gate.counts, session.driver.gate.state
    computing = "computing time with the film's pictures" if filmed else "computing time"
    load = report.work.quantile(0.5) / session.driver.period
    console.print(
        f"{_periods(session)}; {computing} p50 {report.work.quantile(0.5) * 1e3:.2f} ms ({load:.0%} of a "
        f"period), p99.9 {report.work.quantile(0.999) * 1e3:.2f} ms; "
        f"gate: {counts.holds} holds, {counts.stops} stops, {counts.refusals} refusals; "
        f"state at the end: [{_colour(state.name)}]{state.name}[/]",
        highlight=False,
    )
    if words := _too_slow(session):
        console.print(words, style="yellow", highlight=False, markup=False)
    for line in _about_recordings(session):
        console.print(line, highlight=False)
    if log.went_back.counts:
        console.print(MET, style="yellow", highlight=False)
    if state is GateState.STOP:
        words = f"STOP to the end, since nobody reset it: {session.driver.gate.reason}"
        console.print(words, style=COLOURS["STOP"], highlight=False, markup=False)


def _periods(session: Session) -> str:
    """Returns the numbers of executed and missed periods, as text."""
    report = session.report
    periods = f"{report.ticks} periods of {session.driver.period * 1e3:g} ms"
    if not (report.missed or isinstance(session.source.clock, MonotonicClock)):
        return f"{periods}, none missed, since simulated and recorded time wait for this computer"
    return f"{periods}, {report.overruns} overruns ({report.missed} periods missed)"


def _too_slow(session: Session) -> str:
    """Returns a line of text if more than `MISSED` of the periods were missed, else an empty text. Those that
    a recording lacks are not this machine's."""
    report, period = session.report, session.driver.period
    share = report.missed / max(report.ticks + report.missed, 1)
    if share <= MISSED or session.source.info.recorded:
        return ""
    load = report.work.quantile(0.5) / period
    why = "computing takes longer than that" if load > 1.0 else "other programs take the processor"
    return (
        f"this machine can't keep {1.0 / period:.0f} Hz: {share:.0%} of the periods were missed; "
        f"computing takes {load:.0%} of a period ({why})"
    )


def _about_recordings(session: Session) -> list[str]:
    """Returns lines of text about the recording that was written and the recording that was replayed."""
    lines, recorder, driver = [], session.recorder, session.source
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


def _print(event: Event) -> None:
    console.print(_row(f"{event.now:8.3f} s", event.kind, event.words, _colour(event.kind)))


def _colour(kind: str) -> str:
    return COLOURS.get(kind, "yellow")


def _row(time: str, kind: str, words: str, colour: str) -> RenderableType:
    """Returns an event as a row of three columns: time, kind and text. A text that needs several lines stays
    within its column."""
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(min_width=10, justify="right", no_wrap=True)
    table.add_column(width=8, no_wrap=True)
    table.add_column()
    table.add_row(time, Text(kind, style=colour), Text(words))
    return table
