"""The programs of yarpwire's README run unchanged."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import yarpwire
from helpers import HELPERS

README = (Path(yarpwire.__file__).parent / "README.md").read_text()
FIRST, *OTHERS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_five_lines_read_a_port() -> None:
    assert len([line for line in FIRST.splitlines() if line and not line.startswith("import")]) == 5
    words = [sys.executable, str(HELPERS / "yarpwire_five_lines.py")]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)
    assert (done.stdout, done.returncode) == ("[240.  17.]\n", 0), done.stderr


@pytest.mark.parametrize("program", OTHERS)
def test_the_other_programs_run(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    exec(program, {})
    said = re.search(r"print\(.*\)  # (.*)", program)
    assert capsys.readouterr().out == (f"{said[1]}\n" if said else "")
