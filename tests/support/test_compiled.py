"""Cached machine code of a compiled loop is valid until one of its source files changes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numba import config, float64, njit

import tci
from tci.body.generic_body import GenericBody
from tci.capabilities import answer, discounts
from tci.drivers.simulated import SimulatedDriver
from tci.gate.kernels.stops import empty_stop, follow_stop
from tci.messages import Reading
from tci.messages.frames import frozen
from tci.skin.kernels import condition, contacts, nearest
from tci.support import compile_ahead, compiled
from tci.support.compile_ahead import _state, modules_with_loops
from tci.support.compiled import inlined

COVERAGE = GenericBody.coverage
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


def test_the_sources_of_a_loop_include_what_it_calls() -> None:
    for module, made_of in ((condition, condition), (contacts, nearest), (answer, discounts)):
        assert Path(str(made_of.__file__)) in compiled._sources(Path(str(module.__file__)))


PROGRAM = """
from numba import float64
from numba.core.event import install_recorder
from tci.support.compiled import compiled
with install_recorder("numba:compile") as made:
    @compiled(float64(float64))
    def twice(x):
        return 2.0 * x
assert twice(2.0) == 4.0
print(len(made.buffer) > 0)
"""


def _start(program: Path) -> tuple[str, str]:
    """Runs PROGRAM: whether it compiled, and what it wrote to stderr."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(program.parent / "cache")}
    answer = subprocess.run(
        [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
    )
    return answer.stdout.strip(), answer.stderr


def test_starts_after_the_first_load_and_a_damaged_file_is_told_and_made_anew(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    assert _start(program)[0] == "True"
    assert _start(program) == ("False", "")
    (file,) = (tmp_path / "cache").rglob("*.loop")
    file.write_bytes(file.read_bytes()[:-1000])
    assert _start(program) == ("True", f"tci: {file} is damaged: deleted, and compiled anew\n")
    assert _start(program) == ("False", "")


def thrice(x: float) -> float:
    return 3.0 * x


def test_no_cut_and_no_flipped_bit_goes_unseen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Every start with a damaged file works, says so once, and leaves a good file."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    def start() -> Any:
        function = compiled._jit(thrice, _nrt=False)
        compiled.load(function, float64(float64))
        assert function(2.0) == 6.0

    start()
    (file,) = tmp_path.rglob("*.loop")
    good, random = file.read_bytes(), np.random.default_rng(0)
    damages = [good[:n] for n in (0, 1, 31, 32, 33, 63, 64, 65, len(good) - 1)]
    damages += [good[: random.integers(len(good))] for _ in range(20)]
    for bit in (0, 8 * 32, 8 * 64, 8 * len(good) - 1, *random.integers(8 * len(good), size=30).tolist()):
        flipped = bytearray(good)
        flipped[bit // 8] ^= 1 << bit % 8
        damages.append(bytes(flipped))
    capfd.readouterr()
    for damaged in damages:
        file.write_bytes(damaged)
        start()
        assert capfd.readouterr().err == f"tci: {file} is damaged: deleted, and compiled anew\n"
        start()
        assert capfd.readouterr().err == ""


def test_a_loop_works_where_no_file_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(compiled.tempfile, "mkstemp", full)
    function = compiled._jit(thrice, _nrt=False)
    compiled.load(function, float64(float64))
    assert function(2.0) == 6.0
    assert capfd.readouterr().err.endswith("No space left on device\n")


def test_a_file_has_machine_code_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Relies on the form in which numba stores a library. Bitcode would be most of the file."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    function = compiled._jit(thrice, _nrt=False)
    compiled.load(function, float64(float64))
    (made,) = function.overloads.values()
    (_, kind, (machine_code, bitcode)), *_ = compiled.KeptCode(function, float64(float64)).reduce(made)
    assert kind == "object"
    assert len(bitcode) < len(made.library.serialize_using_object_code()[2][1]) / 2
    assert machine_code in next(tmp_path.rglob("*.loop")).read_bytes()


@inlined
def _shifted(values: Any, by: int) -> float:
    return float(values[0] + by)


def test_constants_are_not_compiled_apart() -> None:
    """Relies on `get_call_template` of numba's dispatcher."""

    @njit
    def loop(values: Any, by: int) -> float:
        return float(_shifted(values, 0) + _shifted(values, 1) + _shifted(values, by))

    assert loop(np.ones(1), 2) == 6.0
    assert len(_shifted.overloads) == 1


def test_a_wrong_argument_is_refused() -> None:
    """Loops are called through numba's check of type, contiguity, dimensions and read-only flag."""
    good, speeds = empty_stop(4), frozen(np.zeros(4))
    straight = good, speeds, np.zeros((2, 3, 4))
    follow_stop(good, speeds, np.zeros((4, 3, 4)))
    for wrong in (
        (good._replace(span=good.span.astype(np.float32)), *straight[1:]),
        (good._replace(span=np.zeros((2, 8))[:, ::2]), *straight[1:]),
        (good._replace(span=good.end), *straight[1:]),
        (*straight[:2], frozen(np.zeros((2, 3, 4)))),
    ):
        with pytest.raises(TypeError, match="No matching definition"):
            follow_stop(*wrong)


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
from numba.core.event import install_recorder
with install_recorder("numba:compile") as made:
    from tci.{}.loops import half, twice
assert half(2.0) == 1.0
print(len(made.buffer))
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package of two folders with loops, compiled as TCI's are."""
    made = tmp_path / "tci"
    for folder in ("support", "one", "other"):
        (made / folder).mkdir(parents=True)
        (made / folder / "__init__.py").touch()
    for file in ("__init__.py", "support/compiled.py", "support/compile_ahead.py"):
        (made / file).write_bytes((compiled.HERE / file).read_bytes() if "/" in file else b"")
    for folder in ("one", "other"):
        (made / folder / "loops.py").write_text(LOOPS)
    return made


def _use(package: Path, *folders: str) -> list[tuple[bool, str]]:
    """Starts processes that each use the loops of one folder, at the same time: whether they compiled some
    themselves, and what they wrote to stderr."""
    place = package.parent
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(place / "cache"), "PYTHONPATH": str(place)}
    made = [
        subprocess.Popen(
            [sys.executable, "-c", USE.format(folder)],
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for folder in folders
    ]  # fmt: skip
    found = [process.communicate() for process in made]
    assert not any(process.returncode for process in made), found
    return [(int(answer) > 0, said.replace(f"{WAITS}\n", "")) for answer, said in found]


def test_the_first_process_compiles_side_by_side_and_says_so(package: Path) -> None:
    """Another process that starts meanwhile waits for the first process, although it needs the loops of
    another package."""

    def use(*folders: str) -> list[str]:
        found = _use(package, *folders)
        assert not any(compiled for compiled, _ in found)
        return [said for _, said in found]

    silent, told = sorted(use("one", "other"))
    assert silent == ""
    assert "compiling its loops for this processor, once after installing it: about half a minute" in told
    assert "compiled its loops in" in told
    assert use("one") == [""]
    package.joinpath("one", "loops.py").write_text(LOOPS.replace("2.0", "3.0"))
    assert "compiling" in use("one")[0]


def test_a_worker_that_dies_is_told(package: Path) -> None:
    package.joinpath("other", "loops.py").write_text(f"{LOOPS}\nraise OSError('no such device')\n")
    ((compiled_here, told),) = _use(package, "one")
    assert compiled_here
    assert "tci: a process that compiles loops ended with status 1" in told
    assert "no such device" in told
    assert "compiled its loops" not in told


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


def test_progress_counts_loops(tmp_path: Path) -> None:
    assert _state(tmp_path, 3.0) == "finding its loops"
    names = ["tci.gate.kernels.targets.one", "tci.gate.kernels.targets.other", "tci.skin.kernels.mask.third"]
    (tmp_path / "all").write_text("\n".join(names))
    assert _state(tmp_path, 4.0) == "compiled 0 of 3 loops in 4 s; now the next"
    for package in ("tci.gate.kernels", "tci.skin.kernels"):
        (tmp_path / package).touch()
    (tmp_path / f"{names[0]}.done").touch()
    assert _state(tmp_path, 30.0) == "compiled 1 of 3 loops in 30 s; now gate.kernels, skin.kernels"
    (tmp_path / f"{names[2]}.done").touch()
    assert _state(tmp_path, 60.0) == "compiled 2 of 3 loops in 60 s; now gate.kernels"


@pytest.mark.parametrize("name", modules_with_loops())
def test_no_loop_takes_more_than_ten_arguments(name: str) -> None:
    loops = [one for one in vars(import_module(name)).values() if hasattr(one, "py_func")]
    long = [
        one.py_func.__name__ for one in loops if one.py_func.__code__.co_argcount > 10 and not is_inlined(one)
    ]
    assert long == []


@pytest.mark.parametrize("name", modules_with_loops())
def test_loops_call_only_inlined_loops(name: str) -> None:
    """Numba is not told of loops that were loaded, so it could not link them into others."""
    module = import_module(name)
    loops = [one for one in vars(module).values() if hasattr(one, "py_func")]
    called = [
        one.py_func.__globals__[used]
        for one in loops
        for used in one.py_func.__code__.co_names
        if hasattr(one.py_func.__globals__.get(used), "py_func")
    ]
    assert [one.py_func.__name__ for one in called if not is_inlined(one)] == []


def is_inlined(loop: Any) -> bool:
    """Returns True for a loop that is called only by compiled loops."""
    return bool(getattr(loop, "targetoptions", {}).get("forceinline"))


class Floats(SimulatedDriver):
    """Its skin sends floats, as over most wires, and some of its taxels are noisy."""

    random = np.random.default_rng(0)

    def _receive(self) -> Reading:
        reading = super()._receive()
        frames = [(frame, np.array(frame.values, np.float32)) for frame in reading.skin]
        for _, values in frames:
            values += self.random.standard_normal(len(values))
            values[:40] += 60.0 * self.random.standard_normal(40)
        return replace(reading, skin=tuple(replace(frame, values=values) for frame, values in frames))


def test_no_loop_is_compiled_while_a_robot_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would take two seconds at the first run, and the gate would hold."""

    def refuse(loop: compiled.Seldom, *arguments: object) -> None:
        raise AssertionError(loop.py_func)

    monkeypatch.setattr(compiled.Seldom, "__call__", refuse)
    asked = []
    monkeypatch.setattr(GenericBody, "coverage", lambda *given: asked.append(given) or COVERAGE(*given))
    with Floats("icub") as driver:
        tci.run(driver, tci.WithdrawalReflex(), duration=3.0)
    assert asked
