"""Cached machine code of a compiled loop is valid until one of its source files changes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tci.capabilities import answer, discounts
from tci.skin.kernels import condition, contacts, nearest
from tci.support import compile_ahead, compiled
from tci.support.compile_ahead import _state, modules_with_loops

WAITS = "tci: another tci process compiles its loops; waiting for it"


def test_the_stamp_follows_every_source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stamp covers the file of the loop and all files that this file imports, directly or indirectly, and
    no other files."""
    monkeypatch.setattr(compiled, "HERE", tmp_path)
    (tmp_path / "kernels").mkdir()
    files = {
        "own.py": "from tci.kernels import (\n    near,\n    other_name,\n)\n",
        "kernels/near.py": "from tci.kernels.far import A\n",
        "kernels/far.py": "A = 1\n",
        "kernels/strange.py": "",
    }

    def stamp() -> str:
        compiled._stamp.cache_clear()
        compiled._content.cache_clear()
        compiled._imported.cache_clear()
        return compiled._stamp(tmp_path / "own.py")

    for name, text in files.items():
        (tmp_path / name).write_text(text)
    seen = [stamp()]
    for name, text in files.items():
        (tmp_path / name).write_text(text + "B = 2\n")
        seen.append(stamp())
    assert len(set(seen)) == 4
    assert seen[-1] == seen[-2]  # a change of the file that is not imported


def test_numba_compares_our_stamp() -> None:
    """Numba compares the stamp through a private attribute. The test fails if a version of Numba lacks this
    attribute."""
    for loop, module, made_of in (
        (condition.condition, condition, condition),
        (contacts.describe, contacts, nearest),
        (answer.find_answers, answer, discounts),
    ):
        file = Path(str(module.__file__))
        assert loop._cache._cache_file._source_stamp == compiled._stamp(file)
        assert Path(str(made_of.__file__)) in compiled._sources(file)


PROGRAM = """
import time
from numba import float64
from tci.support import compiled
from tci.support.compile_ahead import modules_with_loops
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
from tci.support.compiled import compiled

@compiled(float64(float64))
def twice(x):
    return 2.0 * x

@compiled(float64(float64))
def half(x):
    return 0.5 * x
"""
USE = """
from tci.{}.loops import half, twice
print(*(sum(one.stats.cache_hits.values()) for one in (half, twice)))
"""


def test_the_first_process_compiles_side_by_side_and_says_so(tmp_path: Path) -> None:
    """Another process that starts meanwhile waits for the first process, although it needs the loops of
    another package."""
    package = tmp_path / "tci"
    for folder in ("robot", "one", "other"):
        (package / folder).mkdir(parents=True)
    for file in ("compiled.py", "compile_ahead.py", "robot/limb.py"):
        (package / file).write_bytes((compiled.HERE / file).read_bytes())
    for file in ("__init__.py", "one/__init__.py", "other/__init__.py"):
        (package / file).touch()
    for folder in ("one", "other"):
        (package / folder / "loops.py").write_text(LOOPS)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}

    def use(*folders: str) -> list[str]:
        """Starts processes that each use the loops of one folder, at the same time, and returns their output
        to stderr."""
        made = [
            subprocess.Popen(
                [sys.executable, "-c", USE.format(folder)],
                env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )
            for folder in folders
        ]  # fmt: skip
        found = [process.communicate() for process in made]
        assert [answer.split() for answer, _ in found] == [["1", "1"]] * len(folders)
        return [said.replace(f"{WAITS}\n", "") for _, said in found]

    silent, told = sorted(use("one", "other"))
    assert silent == ""
    assert "compiling its loops for this processor, once after installing it: about half a minute" in told
    assert "compiled its loops in" in told
    assert use("one") == [""]
    package.joinpath("one", "loops.py").write_text(LOOPS.replace("2.0", "3.0"))
    assert "compiling" in use("one")[0]


def test_a_process_says_that_it_waits_for_another_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    monkeypatch.setattr(sys, "stderr", SimpleNamespace(write=said.append, flush=lambda: None))
    monkeypatch.setattr(compile_ahead, "HERE", tmp_path)
    with compile_ahead._alone():
        assert not said
        waits = threading.Thread(target=_enter_alone)
        waits.start()
        begin = time.monotonic()
        while len(said) < 2 and time.monotonic() - begin < 5.0:
            time.sleep(0.001)
        assert "".join(said) == f"{WAITS}\n"
        assert waits.is_alive()
    waits.join(5.0)
    assert not waits.is_alive()
    assert len(said) == 2


def _enter_alone() -> None:
    with compile_ahead._alone():
        pass


def test_progress_counts_loops_and_weighs_their_length(tmp_path: Path) -> None:
    assert _state(tmp_path, 3.0) == "finding its loops"
    (tmp_path / "all").write_text("long 300\nshort 100\n")
    assert _state(tmp_path, 4.0) == "compiled 0 of 2 loops in 4 s"
    (tmp_path / "long.done").touch()
    assert _state(tmp_path, 30.0) == "compiled 1 of 2 loops in 30 s, about 10 s left"


@pytest.mark.parametrize("name", modules_with_loops())
def test_no_loop_takes_more_than_ten_arguments(name: str) -> None:
    loops = [one for one in vars(import_module(name)).values() if hasattr(one, "py_func")]
    long = [one.__name__ for one in loops if one.py_func.__code__.co_argcount > 10 and not is_inlined(one)]
    assert long == []


@pytest.mark.parametrize("name", modules_with_loops())
def test_loops_call_only_inlined_loops(name: str) -> None:
    """The cache lacks what Numba needs to link a compiled loop into another one."""
    module = import_module(name)
    loops = [one for one in vars(module).values() if hasattr(one, "py_func")]
    called = [
        one.py_func.__globals__[used]
        for one in loops
        for used in one.py_func.__code__.co_names
        if hasattr(one.py_func.__globals__.get(used), "py_func")
    ]
    assert [one.__name__ for one in called if not is_inlined(one)] == []


def is_inlined(loop: Any) -> bool:
    """Returns True for a loop that is called only by compiled loops."""
    return bool(loop.targetoptions.get("forceinline"))
