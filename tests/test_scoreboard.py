"""The scoreboard calls nothing met that was not tried at the whole size, and goes on where it ended."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest

TOOLS = Path(__file__).parents[1] / "tools" / "reliability"


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A module of tools/reliability by its name."""
    monkeypatch.syspath_prepend(str(TOOLS))
    yield lambda name: importlib.import_module(name)
    for name, module in [*sys.modules.items()]:
        if str(getattr(module, "__file__", "")).startswith(str(TOOLS)):
            del sys.modules[name]


@pytest.mark.parametrize(
    ("tried", "sound", "met"),
    [(100, True, "yes"), (99, True, "so far"), (99, False, "no"), (100, False, "no"), (0, True, "open"),
     (100, None, "open")],
)  # fmt: skip
def test_a_short_run_is_never_called_met(tool: Any, tried: int, sound: bool | None, met: str) -> None:
    row = tool("row").Row("name", tried, 100, "times", "figure", "target", sound)
    assert row.met == met
    assert row.to_json()["met"] == met
    if met == "so far":
        assert row.size == "99 of 100 times"


def double(number: int) -> dict[str, int]:
    return {"twice": 2 * number}


def test_what_was_done_is_kept_and_not_done_again(
    tool: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pool = tool("pool")
    monkeypatch.setenv("OUT", str(tmp_path))
    monkeypatch.setenv("JOBS", "1")
    jobs = [(number,) for number in range(6)]
    monkeypatch.setenv("PART", "0/2")
    assert [d["twice"] for d in pool.gather("row", double, jobs, full=True)] == [0, 4, 8]
    monkeypatch.setenv("PART", "0/1")
    kept = tmp_path / "reliability" / "row.jsonl"
    assert len(kept.read_text().splitlines()) == 3
    assert [d["twice"] for d in pool.gather("row", double, jobs, full=True)] == [0, 2, 4, 6, 8, 10]
    assert len(kept.read_text().splitlines()) == 6, "none was done again"
    kept.write_text(kept.read_text().replace(pool.sources(), "others"))
    assert len(pool.gather("row", double, jobs[:2], full=True)) == 2
    assert len(kept.read_text().splitlines()) == 8, "of other sources nothing counts"
    monkeypatch.setenv("MINUTES", "0")
    assert len(pool.gather("row", double, jobs, full=True)) == 2, "what was kept last"
    assert pool.COMMITS["row"]


def half(number: int) -> dict[str, float]:
    return {"half": 1 / number}


def test_a_job_that_fails_takes_no_other_with_it(
    tool: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("OUT", str(tmp_path))
    monkeypatch.setenv("JOBS", "1")
    with pytest.raises(ZeroDivisionError) as raised:
        tool("pool").gather("row", half, [(0,), (1,), (2,)], full=True)
    assert raised.value.__notes__ == ["row [0]"]
    assert len((tmp_path / "reliability" / "row.jsonl").read_text().splitlines()) == 2


def test_a_row_that_was_not_tried_stays_as_it_is_on_the_page(tool: Any, tmp_path: Path) -> None:
    row, page = tool("row"), tool("page")
    path = tmp_path / "page.md"
    old = "| a | 9 times | fine | 0 | yes | abc |\n| b | 9 times | fine | 0 | yes | abc |\n"
    path.write_text(f"before\n{page.BEGIN}{page.HEAD}{old}{page.END}after\n")
    tried = row.Row("a", 10, 10, "times", "bad", "0", False, "def")
    page.write_page(
        [tried, row.Row("b", 0, 10, "times", "", "0", True), row.Row("c", 0, 10, "", "", "0", True)], path
    )
    new = "| a | 10 times | bad | 0 | no | def |\n" + old.splitlines(keepends=True)[1]
    new += "| c | 0 of 10  | not run | 0 | open |  |\n"
    assert path.read_text() == f"before\n{page.BEGIN}{page.HEAD}{new}{page.END}after\n"


@pytest.mark.parametrize(
    ("file", "row"),
    [("attacks", "limits"), ("gate", "non_finite"), ("explore", "loop"), ("bytes_in", "descriptions"),
     ("bytes_in", "heartbeats"), ("wires", "wires")],
)  # fmt: skip
def test_rows_that_need_no_clock_are_sound_at_the_size_of_ci(
    tool: Any, monkeypatch: pytest.MonkeyPatch, file: str, row: str
) -> None:
    monkeypatch.setenv("JOBS", "1")
    done = getattr(tool(file), row)(False)
    assert done.met == "so far", done.figure
