"""Every example runs without changes, as a user would run it."""

from __future__ import annotations

import runpy
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from helpers import ROOT
from helpers.printed import words_of

README = (ROOT / "README.md").read_text()
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


SAID = {
    "01_five_lines": "nao: touched left_forearm (",
    "02_every_step": "left_arm withdraws",
    "12_stepper": "951 periods, 0 perceptions were not read in time\nnao: touched left_forearm (",
    "10_test_a_capability": "0.04 s: [('right_forearm', 3.9, 1)], ended: ()\n0.06 s: [], ended: (1,)",
}
"""Text that the output of an example contains, by the name of the example."""


@cache
def ran(path: Path) -> subprocess.CompletedProcess[str]:
    """Returns the output of an example, which runs once for all tests."""
    return subprocess.run([sys.executable, str(path)], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example(path: Path) -> None:
    run = ran(path)
    assert run.returncode == 0, run.stderr
    assert SAID.get(path.stem, "") in run.stdout
    if path == EXAMPLES[0]:
        assert words_of(README.split("```text\n")[1].split("```")[0]) == words_of(run.stdout)


def test_a_loop_of_ones_own_says_that_degrees_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (example,) = (path for path in EXAMPLES if path.stem == "03_native_joints")
    (tmp_path / "degrees.py").write_text(example.read_text().replace("np.deg2rad(-30)", "-30"))
    runpy.run_path(str(tmp_path / "degrees.py"))
    said, wrist = capsys.readouterr().out.splitlines()
    assert "l_wrist_pitch" in said
    assert "radians" in said
    assert "is at 0.0 degrees" in wrist.replace("-0.0", "0.0")


def test_a_move_takes_as_long_whatever_rate_a_loop_has() -> None:
    (example,) = (path for path in EXAMPLES if path.stem == "09_own_rate")
    run = ran(example)
    times = [float(line.split()[-2]) for line in run.stdout.splitlines()]
    assert len(times) == 4
    assert max(times) - min(times) <= 0.03, run.stdout
    assert "gate.step is called" not in run.stderr


def test_the_five_lines_of_the_readme_are_the_first_example() -> None:
    program = README.split("```python\n")[1].split("```")[0]
    assert EXAMPLES[0].read_text().split('"""\n\n', 1)[1] == program
    assert len([line for line in program.splitlines() if line]) <= 5
