"""Programs with which tests exchange data. If a program is missing, the test run prints how to install it."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from functools import cache
from types import ModuleType

import pytest

from helpers import ROOT
from yarpwire.bindings.module import load, version
from yarpwire.errors import BindingsError

DEBIAN_PYTHON = "/usr/bin/python3"
"""Debian's own Python with Debian's modules, which the virtual environment lacks."""


@cache
def _imports(module: str) -> bool:
    try:
        command = [DEBIAN_PYTHON, "-c", f"import {module}"]
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def needs_debian_module(module: str, package: str) -> None:
    """Skips the test, with advice, unless Debian's Python can import `module`."""
    if not _imports(module):
        pytest.skip(f"did not run: needs {module}; to get it, as root: apt-get install {package}")


def needs_program(name: str, package: str) -> str:
    """Returns the path of a Debian program. Skips the test, with advice, if the program is missing."""
    path = shutil.which(name)
    if path is None:
        pytest.skip(f"did not run: needs {name}; to get it, as root: apt-get install {package}")
    return path


def peer_python(name: str) -> str:
    """Returns the Python of a peer program that has a separate environment. Skips the test, with advice, if
    it is missing."""
    return peer_program(name, "python")


def peer_program(name: str, program: str) -> str:
    """Returns a program in the environment of a peer. Skips the test, with advice, if the program is
    missing."""
    path = ROOT / ".peers" / name / "bin" / program
    if not path.exists():
        pytest.skip(f"did not run: needs .peers/{name}; to get it: python3 tools/peers.py")
    return str(path)


def node_packages(name: str) -> str:
    """Returns the folder with the Node packages of a peer. Skips the test, with advice, if the folder is
    missing."""
    folder = ROOT / ".peers" / name
    if not (folder / "installed").exists():
        pytest.skip(f"did not run: needs .peers/{name}; to get it: python3 tools/peers.py")
    return str(folder)


def needs_pinocchio() -> ModuleType:
    """Imports Pinocchio. Without the system library OpenMP, skips the test or the whole file, with advice."""
    try:
        return importlib.import_module("pinocchio")
    except ImportError as error:
        pytest.skip(
            f"did not run: {error}; to get it, as root: apt-get install libgomp1", allow_module_level=True
        )


@cache
def bindings_dialect() -> str | None:
    """Returns the dialect of YARP's own bindings, `3` or `4`; None if this Python can't import them."""
    try:
        return version(load())[1].name
    except BindingsError:
        return None


def needs_yarp_bindings() -> str:
    """Returns the dialect of YARP's bindings; skips the whole file, with advice, if they are missing."""
    dialect = bindings_dialect()
    if dialect is None:
        pytest.skip(
            "did not run: needs YARP's own bindings, which neither Debian nor PyPI has; to get them: conda "
            "install -c conda-forge yarp-python, or PYTHONPATH=BUILD/lib/python3 of a YARP built with them",
            allow_module_level=True,
        )
    return dialect


def debian_python(script: str, stdin: str) -> str:
    """Returns the output of a script that Debian's Python runs. If the script fails, fails the test with the
    script's errors."""
    command = [DEBIAN_PYTHON, "-c", script]
    answer = subprocess.run(command, input=stdin, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout
