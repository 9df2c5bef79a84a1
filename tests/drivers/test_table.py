"""The table of middlewares in the docs has a row for each, and the whole contract in it."""

from __future__ import annotations

from pathlib import Path

from drivers import test_driver
from drivers.wires import PEERS

TABLE = Path(__file__).parents[2] / "docs" / "tables" / "middleware.md"


def test_the_table_has_every_middleware_and_the_whole_contract() -> None:
    lines = [line for line in TABLE.read_text().splitlines() if line.startswith("|")]
    head, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert [row[0].strip("`") for row in rows] == [name for name in PEERS if name != "sim"]
    size = sum(name.startswith("test_") for name in vars(test_driver))
    for row in rows:
        assert len(row) == len(head)
        assert all(row)
        assert row[1].endswith(f" of {size}"), "make middleware takes the table again"
