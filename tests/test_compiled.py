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
