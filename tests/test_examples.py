"""Every example runs as a user would run it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parent.parent / "examples").glob("*.py"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path: Path) -> None:
    run = subprocess.run([sys.executable, str(path)], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr


def test_the_reflex_answers_in_the_long_example() -> None:
    run = subprocess.run([sys.executable, str(EXAMPLES[1])], capture_output=True, text=True, check=True)
    assert "left_arm withdraws" in run.stdout


def test_a_move_takes_as_long_whatever_rate_a_loop_has() -> None:
    (example,) = (path for path in EXAMPLES if path.stem == "09_own_rate")
    run = subprocess.run([sys.executable, str(example)], capture_output=True, text=True, check=True)
    times = [float(line.split()[-2]) for line in run.stdout.splitlines()]
    assert len(times) == 4
    assert max(times) - min(times) <= 0.03, run.stdout
    assert "gate.step is called" not in run.stderr
