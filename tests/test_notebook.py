"""The notebook runs from top to bottom and prints the output that its page shows."""

from __future__ import annotations

import contextlib
import io
import re
from typing import Any

from helpers import ROOT

PAGE = ROOT / "docs" / "notebook.md"
CELL = re.compile(r"```python\n(.*?)```\n\n```text\n(.*?)```", re.DOTALL)
NUMBER = re.compile(r"\d+(?:\.\d+)?")


def test_the_notebook_prints_what_it_shows() -> None:
    cells = CELL.findall(PAGE.read_text())
    assert len(cells) == PAGE.read_text().count("```python") == 7
    names: dict[str, Any] = {}
    for code, shown in cells:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, str(PAGE), "exec"), names)
        assert NUMBER.sub("0", printed.getvalue()) == NUMBER.sub("0", shown), code
        for got, expected in zip(NUMBER.findall(printed.getvalue()), NUMBER.findall(shown), strict=True):
            last_digit = 10.0 ** -len(expected.partition(".")[2])  # it differs between processors
            assert abs(float(got) - float(expected)) < 1.5 * last_digit, (code, got, expected)
    assert names["path"].with_name("notebook.png").stat().st_size > 5000
