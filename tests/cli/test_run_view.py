"""The lines that a run prints."""

from __future__ import annotations

from io import StringIO
from types import SimpleNamespace

import pytest
from rich.console import Console

from tci.cli.run_log import Event
from tci.cli.run_view import RunView, _row, _too_slow


@pytest.mark.parametrize("time", ["0.020 s", "1795785600.123 s"])
def test_the_time_of_an_event_is_whole_on_a_clock_of_the_wall_too(time: str) -> None:
    shown = Console(file=StringIO(), width=100)
    shown.print(_row(time, "OPERATOR", "the text of an event " * 8, "red"))
    lines = shown.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert f"{time}  OPERATOR  the" in lines[0]
    assert lines[1].startswith(" " * max(10, len(time)))


def test_times_count_from_the_begin_of_the_run(capsys: pytest.CaptureFixture[str]) -> None:
    """Over a wire they were those of the computer's own clock."""
    view = RunView(quiet=False)
    with view.shown():
        for now, kind in ((81234.5, "touch"), (81235.75, "HOLD")):
            view.event(Event(now, kind, "words"))
    times = [line.split()[0] for line in capsys.readouterr().out.splitlines() if "words" in line]
    assert times == ["0.000", "1.250"]


@pytest.mark.parametrize("recorded", [True, False])
def test_what_a_recording_lacks_is_not_blamed_on_the_machine(recorded: bool) -> None:
    session = SimpleNamespace(
        report=SimpleNamespace(ticks=2378, missed=622, work=SimpleNamespace(quantile=lambda _: 2e-4)),
        driver=SimpleNamespace(period=0.002),
        source=SimpleNamespace(info=SimpleNamespace(recorded=recorded)),
    )
    assert bool(_too_slow(session)) is not recorded  # type: ignore[arg-type]
