"""Other programs that the tests start. A peer that is not there is named, with how to get it."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from yarpwire.bindings.module import load, version
from yarpwire.errors import BindingsError

ROOT = Path(__file__).parent.parent
DEBIAN_PYTHON = "/usr/bin/python3"
"""Debian's own Python, which has Debian's modules; the virtual environment has none of them."""


@cache
def _imports(module: str) -> bool:
    try:
        command = [DEBIAN_PYTHON, "-c", f"import {module}"]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def needs_debian_module(module: str, package: str) -> None:
    """Go on only where Debian's Python can import `module`; elsewhere the test is named as not run."""
    if not _imports(module):
        pytest.skip(f"did not run: needs {module}; to get it, as root: apt-get install {package}")


def needs_program(name: str, package: str) -> str:
    """Path of a Debian program; where there is none the test is named as not run."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"did not run: needs {name}; to get it, as root: apt-get install {package}")
    return path


def peer_python(name: str) -> str:
    """The Python of a peer with its own environment; where there is none, the test is named as not run."""
    return peer_program(name, "python")


def peer_program(name: str, program: str) -> str:
    """A program in a peer's environment; where there is none, the test is named as not run."""
    path = ROOT / ".peers" / name / "bin" / program
    if not path.exists():
        pytest.skip(f"did not run: needs .peers/{name}; to get it: python3 tools/peers.py")
    return str(path)


def node_packages(name: str) -> str:
    """The folder with a peer's packages of Node; where there is none, the test is named as not run."""
    folder = ROOT / ".peers" / name
    if not (folder / "installed").exists():
        pytest.skip(f"did not run: needs .peers/{name}; to get it: python3 tools/peers.py")
    return str(folder)


def needs_pinocchio() -> ModuleType:
    """Pinocchio; without the system's OpenMP the whole file, or test, is named as not run."""
    try:
        return importlib.import_module("pinocchio")
    except ImportError as error:
        pytest.skip(
            f"did not run: {error}; to get it, as root: apt-get install libgomp1", allow_module_level=True
        )


@cache
def bindings_dialect() -> str | None:
    """What YARP's own bindings speak, `3` or `4`; None where this Python can't import them."""
    try:
        return version(load())[1].name
    except BindingsError:
        return None


def needs_yarp_bindings() -> str:
    """Their dialect; where they are not, the whole file is named as not run."""
    dialect = bindings_dialect()
    if dialect is None:
        pytest.skip(
            "did not run: needs YARP's own bindings, which neither Debian nor PyPI has; to get them: conda "
            "install -c conda-forge yarp-python, or PYTHONPATH=BUILD/lib/python3 of a YARP built with them",
            allow_module_level=True,
        )
    return dialect


def debian_python(script: str, stdin: str) -> str:
    """What a script prints that Debian's Python runs; its errors are ours."""
    command = [DEBIAN_PYTHON, "-c", script]
    answer = subprocess.run(command, input=stdin, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout
