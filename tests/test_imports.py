"""`import tci` and `tci --help` start fast, because they load no module that is larger than NumPy."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import tci
from helpers import ROOT
from tci import errors
from tci.cli.main import app

HEAVY = ("pydantic", "lxml", "mujoco", "scipy", "matplotlib", "ruckig", "typer", "rich", "gymnasium")


def loaded(program: str) -> set[str]:
    command = [sys.executable, "-c", f"{program}\nimport sys; print(*sys.modules)"]
    return set(subprocess.run(command, capture_output=True, text=True, check=True).stdout.split())


def test_import_loads_nothing_heavy() -> None:
    assert not loaded("import tci") & set(HEAVY)


@pytest.mark.parametrize(
    "program", ["import tci.cli.main", "from tci.cli.completion import robots; robots('')"]
)
def test_help_and_completion_load_no_simulation(program: str) -> None:
    assert not loaded(program) & {"mujoco", "scipy", "matplotlib", "ruckig", "lxml", "pydantic"}


def test_a_run_of_sleeves_loads_no_scipy() -> None:
    """The import of `scipy.spatial` takes a fifth of the start. Numba loads only `scipy` itself."""
    run = "tci.run(driver, tci.WithdrawalReflex(), duration=0.002)"
    for robot in ("nao", "g1"):
        found = loaded(f"import tci\nwith tci.connect(tci.load_robot('{robot}'), 'sim') as driver: {run}")
        assert not found & {"scipy.spatial", "scipy.sparse", "scipy.optimize", "scipy.linalg"}


def test_the_viewer_loads_no_mesh_library_and_no_optimiser() -> None:
    """trimesh and the modules that it loads need 20 MB of memory."""
    assert not loaded("import tci.lab.viewer.app") & {"trimesh", "scipy.optimize"}


@pytest.mark.parametrize("name", dir(tci))
def test_every_public_name_exists(name: str) -> None:
    assert getattr(tci, name) is not None


def test_without_an_extra_introspection_works_and_an_import_names_the_extra() -> None:
    """`help`, completion and mocks load each name in `dir(tci)`. Without the extra this must not fail, but an
    import of the name must still print how to install the extra."""
    code = (
        "import inspect, sys; sys.modules['py_trees'] = None; import tci\n"
        "found = dict(inspect.getmembers(tci))\n"
        "print('run' in found, 'BehaviourTree' in found)\n"
        "try: from tci import BehaviourTree\n"
        "except tci.MissingExtraError as error: print(error)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.startswith("True False\na behaviour tree needs py_trees")
    assert "pip install" in said


PAGES = [*ROOT.glob("docs/*.md"), ROOT / "README.md"]
DEEP = re.compile(r"^\s*(?:from tci\.|import tci\.)(?!lab$|lab ).*$", re.MULTILINE)


@pytest.mark.parametrize("path", [*sorted(ROOT.glob("examples/*.py")), *PAGES], ids=lambda path: path.name)
def test_examples_and_pages_import_from_tci_only(path: Path) -> None:
    """All names that a user needs are in `dir(tci)`, so examples and pages import no submodule."""
    text = path.read_text()
    shown = [text] if path.suffix == ".py" else re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert not [line for code in shown for line in DEEP.findall(code)]
    for name in {name for code in shown for name in re.findall(r"(?<![\w/])tci\.(\w+)", code)}:
        assert name == "lab" or name in dir(tci), name


def test_every_error_is_public() -> None:
    found = [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, Exception)]
    assert len(found) > 8
    assert {one.__name__ for one in found} <= set(dir(tci))


def test_the_command_tells_its_version() -> None:
    done = CliRunner().invoke(app, ["--version"])
    assert (done.exit_code, done.output) == (0, f"tci {tci.__version__}\n")


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = tci.no_such_name


ELSEWHERE = """
import os, signal, sys
for module in ("fcntl", "grp", "pwd", "resource", "termios"):
    sys.modules[module] = None
for name in ("fork", "register_at_fork", "getuid", "sched_getaffinity", "O_DIRECTORY", "O_NOFOLLOW"):
    delattr(os, name)
for name in ("SIGHUP", "SIGKILL", "sigwait", "pthread_sigmask"):
    delattr(signal, name)
exec(open(sys.argv[1]).read())
from tci.drivers.lease import Lease
try:
    Lease("yarp:somewhere")
except tci.DriverError as error:
    print(error)
"""
"""Runs an example without the parts of POSIX that Windows lacks."""


def test_simulations_run_where_posix_is_missing_and_robots_are_refused() -> None:
    command = [sys.executable, "-c", ELSEWHERE, str(ROOT / "examples" / "01_five_lines.py")]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "nao: touched left_forearm" in told
    assert "yarp:somewhere can't be commanded from this system" in told
    assert "valid here: simulated robots and recordings" in told
