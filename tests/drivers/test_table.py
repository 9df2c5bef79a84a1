"""The table of middlewares in the docs has a row for each middleware, and contains the complete contract."""

from __future__ import annotations

import tci
from drivers import test_driver
from helpers import ROOT
from helpers.wire_peers import PEERS
from tci.capabilities import lacks

TABLES = ROOT / "docs" / "tables"
WIRES = [name for name in PEERS if name != "sim"]


def rows(table: str) -> tuple[list[str], list[list[str]]]:
    """Returns the header and the rows of a table, without the marks of code."""
    lines = [line for line in (TABLES / table).read_text().splitlines() if line.startswith("|")]
    head, _, *cells = [[cell.strip(" `") for cell in line.strip("|").split("|")] for line in lines]
    return head, cells


def test_the_table_has_every_middleware_and_the_whole_contract() -> None:
    head, cells = rows("middleware.md")
    assert [row[0] for row in cells] == WIRES
    size = sum(name.startswith("test_") for name in vars(test_driver))
    for row in cells:
        assert len(row) == len(head)
        assert all(row)
        assert row[1].endswith(f" of {size}"), "make middleware takes the table again"


def test_every_robot_was_run_over_every_middleware_that_carries_skin() -> None:
    head, cells = rows("robots-and-wires.md")
    assert head[1:] == [name for name in WIRES if name != "unitree"]
    reflexes = tci.WithdrawalReflex(), tci.BodyWithdrawal()
    robots = {name: tci.load_robot(name) for name in tci.robot_names()}
    answer = {name for name, robot in robots.items() if not all(lacks(one, robot) for one in reflexes)}
    assert {row[0] for row in cells} == {name for name in answer if robots[name].skin}
    for robot, *figures in cells:
        for wire, cell in zip(head[1:], figures, strict=True):
            answered, _, rest = cell.partition(" of ")
            if wire == "naoqi" and not robot.startswith("nao"):
                assert "binding" in cell
            else:
                missing = rest.split(",")[0] != answered
                assert int(answered) > 0, (robot, wire)
                assert not missing or ": " in cell, f"{robot} via {wire}: {cell} without a reason"
