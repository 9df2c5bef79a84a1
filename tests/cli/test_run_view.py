"""The lines that a run prints."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from tci.cli.run_view import _row


@pytest.mark.parametrize("time", ["0.020 s", "1795785600.123 s"])
def test_the_time_of_an_event_is_whole_on_a_clock_of_the_wall_too(time: str) -> None:
    shown = Console(file=StringIO(), width=100)
    shown.print(_row(time, "OPERATOR", "the text of an event " * 8, "red"))
    lines = shown.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert f"{time}  OPERATOR  the" in lines[0]
    assert lines[1].startswith(" " * max(10, len(time)))
