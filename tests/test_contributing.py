"""The smallest robot, wire and capability of CONTRIBUTING.md work together as they stand there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import tci
from helpers import HELPERS, ROOT
from tci.errors import DriverError
from tci.robot.xml import read_robot

PAGE = (ROOT / "CONTRIBUTING.md").read_text()


def programs(page: str) -> dict[str, Any]:
    names: dict[str, Any] = {"__name__": "contributed"}
    for program in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(program, names)
    return names


def test_the_smallest_robot_looks_left_over_the_smallest_wire(tmp_path: Path) -> None:
    description, model = re.findall(r"```xml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "robot.xml").write_text(description)
    (tmp_path / "tiny.xml").write_text(model)
    robot, names = read_robot(tmp_path / "robot.xml"), programs(PAGE)
    with names["LampDriver"](robot, arm=True) as driver:
        result = tci.run(driver, names["LookLeft"](), duration=1.0)
        assert not result.refusals
        assert driver.angle[0] == pytest.approx(0.5, abs=0.01)
    with names["LampDriver"](robot) as driver, pytest.raises(DriverError, match="arm=True"):
        driver.write(driver.gate.step([], driver.read().joints, driver.clock.now()))


def test_the_page_of_helpers_lists_each_of_them() -> None:
    listed = set(re.findall(r"`(\w+)`", (HELPERS / "README.md").read_text()))
    assert {path.stem for path in HELPERS.glob("*.py")} - {"__init__"} - listed == set()


def test_tools_and_helpers_import_no_test() -> None:
    """What two tests need is a helper. A helper that imported a test would run its module twice."""
    found = [
        f"{path.relative_to(ROOT)}: {line}"
        for folder in (HELPERS, ROOT / "tools")
        for path in sorted(folder.rglob("*.py"))
        for line in re.findall(r"^\s*(?:from|import) .*\btest_\w+.*$", path.read_text(), re.MULTILINE)
    ]
    assert not found
