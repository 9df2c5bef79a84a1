"""What is kept on disk of a compiled loop is valid as long as all of its sources are as they were."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

from tci import compiled
from tci.capabilities import answer, discounts
from tci.skin.kernels import condition, nearest, whole


def test_the_stamp_follows_every_source(tmp_path: Path) -> None:
    called, own = tmp_path / "called.py", tmp_path / "own.py"
    called.write_text("A = 1\n")
    own.write_text("B = 1\n")
    module = ModuleType("called")
    module.__file__ = str(called)
    first = compiled._stamp(own, (module,))
    assert compiled._stamp(own, (module,)) == first
    called.write_text("A = 2\n")
    second = compiled._stamp(own, (module,))
    own.write_text("B = 2\n")
    assert len({first, second, compiled._stamp(own, (module,))}) == 3


def test_numba_compares_our_stamp() -> None:
    """It does so through a name of its own: a version without it must not go unnoticed."""
    for loop, module, calls in (
        (condition.condition, condition, ()),
        (whole.describe_all, whole, ()),
        (answer.find_answers, answer, (discounts,)),
    ):
        stamp = compiled._stamp(Path(module.__file__), calls)
        assert loop._cache._cache_file._source_stamp == stamp
    assert Path(nearest.__file__) in set(compiled.HERE.glob("*/kernels/*.py"))


PROGRAM = """
import time
from numba import float64
from tci import compiled
@compiled.compiled(float64(float64))
def twice(x):
    return 2.0 * x
assert twice(2.0) == 4.0
print(sum(twice.stats.cache_hits.values()), sum(twice.stats.cache_misses.values()))
"""


def test_the_second_process_loads_what_the_first_compiled(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    answers = [
        subprocess.run(
            [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
        ).stdout.split()
        for _ in range(2)
    ]
    assert answers == [["0", "1"], ["1", "0"]]


LOOPS = """
from numba import float64
from tci.compiled import compiled

@compiled(float64(float64))
def twice(x):
    return 2.0 * x

@compiled(float64(float64))
def half(x):
    return 0.5 * x
"""
USE = """
from tci.loops import half, twice
print(*(sum(one.stats.cache_hits.values()) for one in (half, twice)))
"""


def test_the_first_process_compiles_side_by_side_and_says_so(tmp_path: Path) -> None:
    package = tmp_path / "tci"
    (package / "robot").mkdir(parents=True)
    for file in ("compiled.py", "compile_ahead.py", "robot/limb.py"):
        (package / file).write_bytes((compiled.HERE / file).read_bytes())
    (package / "__init__.py").touch()
    (package / "loops.py").write_text(LOOPS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    first, second = (
        subprocess.run(
            [sys.executable, "-c", USE], env=environment, capture_output=True, text=True, check=True
        )
        for _ in range(2)
    )
    assert first.stdout.split() == second.stdout.split() == ["1", "1"]
    assert "compiling its loops for this processor, once after installing it: done in" in first.stderr
    assert second.stderr == ""
    package.joinpath("loops.py").write_text(LOOPS.replace("2.0", "3.0"))
    third = subprocess.run(
        [sys.executable, "-c", USE], env=environment, capture_output=True, text=True, check=True
    )
    assert "compiling" in third.stderr
