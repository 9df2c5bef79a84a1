"""The scoreboard marks a row as met only after a run of full size, and continues an interrupted run."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest

from helpers import ROOT, TESTS

TOOLS = ROOT / "tools" / "reliability"


@pytest.fixture
def tool(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns a module of tools/reliability by its name."""
    # the folder that is inserted last is searched first
    for folder in (TOOLS.parent, TESTS, TOOLS):
        monkeypatch.syspath_prepend(str(folder))
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


@pytest.mark.parametrize("file", sorted(path.stem for path in TOOLS.glob("[a-z]*.py")))
def test_every_file_of_rows_loads(tool: Any, file: str) -> None:
    """A name that the product has lost would stop every row."""
    assert tool(file)


def double(number: int) -> dict[str, int]:
    return {"twice": 2 * number}


def test_what_was_done_is_kept_and_not_done_again(
    tool: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pool = tool("pool")
    monkeypatch.setenv("OUT", str(tmp_path))
    monkeypatch.setenv("JOBS", "1")
    jobs = [(number,) for number in range(6)]
    monkeypatch.setenv("SHARD", "1/2")
    assert [d["twice"] for d in pool.gather("row", double, jobs, full=True)] == [0, 4, 8]
    monkeypatch.setenv("SHARD", "1/1")
    folder = tmp_path / "reliability" / "row"
    assert [d["twice"] for d in pool.gather("row", double, jobs, full=True)] == [0, 2, 4, 6, 8, 10]
    kept = {path.name: path.read_text() for path in folder.iterdir()}
    assert {name: len(text.splitlines()) for name, text in kept.items()} == {
        "1-of-2.jsonl": 3, "1-of-1.jsonl": 3
    }, "none was done again"  # fmt: skip
    for name, text in kept.items():
        (folder / name).write_text(text.replace(pool.sources(), "others"))
    assert len(pool.gather("row", double, jobs[:2], full=True)) == 2
    assert len((folder / "1-of-1.jsonl").read_text().splitlines()) == 5, "of other sources nothing counts"
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
    assert raised.value.__notes__[0] == "job [0]"
    assert len((tmp_path / "reliability" / "row" / "1-of-1.jsonl").read_text().splitlines()) == 2


def test_a_row_that_was_not_tried_stays_as_it_is_on_the_page(tool: Any, tmp_path: Path) -> None:
    row, head = tool("row"), tool("report").markdown(tool("row").HEAD, [])
    path = tmp_path / "page.md"
    old = "| a | 9 times | fine | 0 | yes | abc |\n| b | 9 times | fine | 0 | yes | abc |\n"
    path.write_text(f"before\n{row.BEGIN}{head}{old}{row.END}after\n")
    tried = row.Row("a", 10, 10, "times", "bad", "0", False, "def")
    row.write_page(
        [tried, row.Row("b", 0, 10, "times", "", "0", True), row.Row("c", 0, 10, "", "", "0", True)], path
    )
    new = "| a | 10 times | bad | 0 | no | def |\n" + old.splitlines(keepends=True)[1]
    new += "| c | 0 of 10  | not run | 0 | open |  |\n"
    assert path.read_text() == f"before\n{row.BEGIN}{head}{new}{row.END}after\n"


def test_each_line_of_a_table_on_the_page_has_the_cells_of_its_head(tool: Any) -> None:
    """In an earlier version of the page, a row that was written by hand had replaced a line of another
    table."""
    tables: list[list[str]] = [[]]
    for line in tool("row").PAGE.read_text().splitlines():
        if line.startswith("|"):
            tables[-1].append(line)
        elif tables[-1]:
            tables.append([])
    heads = [table[0].split(" | ") for table in tables if table]
    assert any(len(head) == len(tool("row").HEAD) for head in heads)
    for table in filter(None, tables):
        wrong = [line for line in table if line.count(" | ") != table[0].count(" | ") and "|---" not in line]
        assert not wrong


@pytest.mark.parametrize(
    ("file", "row"),
    [("attacks", "limits"), ("non_finite", "non_finite"), ("explore", "loop"),
     ("bytes_in", "descriptions"), ("bytes_in", "heartbeats"), ("wires", "wires")],
)  # fmt: skip
def test_rows_that_need_no_clock_are_sound_at_the_size_of_ci(
    tool: Any, monkeypatch: pytest.MonkeyPatch, file: str, row: str
) -> None:
    monkeypatch.setenv("JOBS", "1")
    done = getattr(tool(file), row)(False)
    assert done.met == "so far", done.figure


@pytest.mark.parametrize(("slowest", "met"), [(0.33e-3, "yes"), (0.37e-3, "no")])
def test_the_loop_is_judged_by_its_threads_time_and_told_beside_a_bare_loop(
    tool: Any, monkeypatch: pytest.MonkeyPatch, slowest: float, met: str
) -> None:
    timing = tool("timing")

    def times(usual: float, most: float) -> list[int]:
        histogram = timing.Histogram()
        for number in range(10_000):
            histogram.add(most if number % 500 == 0 else usual)
        counts: list[int] = histogram.counts.tolist()
        return counts

    piece = {
        "seconds": 3600.0, "how": "", "own": times(40e-6, slowest), "late": times(1e-6, 20e-3),
        "bare_own": times(10e-6, 0.1e-3), "bare_late": times(1e-6, 20e-3), "faults": 0.25, "slope": 0.5,
        "moving": 0.1, "missed": 3, "unreported": 0, "usual_kb": 2.0, "most_kb": 40.0, "kept": 0.0,
    }  # fmt: skip
    monkeypatch.setattr(timing, "gather", lambda *_, **__: [piece])
    row = timing.one_kilohertz(full=True)
    assert row.met == met
    assert "(4.0 and 3." in row.figure
    assert "2.0 kB (median), 40 kB (largest), 0.000 blocks kept; 0.25 page faults" in row.figure


FUNCTION = """\
    def function(self, a):
        # adds
        if (
            a > 0
        ):
            b = a + 1
            for c in range(b):
                a += c
        return (
            a,
            b,
        )
"""


@pytest.mark.parametrize(
    ("before", "after", "lines"),
    [
        ("a > 0", "a >= 0", (2, 5)),
        ("a + 1", "a - 1", (5, 6)),
        ("range(b)", "range(None)", (6, 7)),
        ("a += c", "a -= c", (7, 8)),
        ("            b,\n", "            None,\n", (8, 12)),
        ("            b,\n", "", (8, 12)),
        ("self, a):", "self, a=1):", (0, 12)),
        ("b = a + 1\n            for c in range(b)", "b = None\n            for c in range(1)", (2, 8)),
    ],
)
def test_the_statement_that_a_mutant_changes_is_found(
    tool: Any, before: str, after: str, lines: tuple[int, int]
) -> None:
    """A compound statement counts as its head if nothing else has changed."""
    assert FUNCTION.count(before) == 1
    found = tool("mutants").changed_statement(
        FUNCTION.splitlines(), FUNCTION.replace(before, after).splitlines()
    )
    assert found == range(*lines)
