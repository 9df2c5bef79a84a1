"""`import tci` and `tci --help` start fast, because they load no module that is larger than NumPy."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
from typer.testing import CliRunner

import tci
from helpers import ROOT
from helpers.public_names import public_names, public_objects
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


@pytest.mark.parametrize("package", public_names())
def test_every_public_name_exists_and_hides_no_module(package: str) -> None:
    """`dir` lists them all, for editors and `help`. A module with the name would replace it once imported."""
    module = import_module(package)
    for name in public_names()[package]:
        assert name in dir(module)
        assert getattr(module, name) is not None
        assert find_spec(package) is None or not is_module(f"{package}.{name}"), name


def is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:  # the parent is a module, not a package
        return False


def test_what_programs_need_is_at_the_top() -> None:
    assert 30 < len(tci.__all__) < 50
    found = [one for one in vars(errors).values() if isinstance(one, type) and issubclass(one, Exception)]
    assert len(found) > 8
    assert {one.__name__ for one in found} <= set(tci.__all__)


def test_without_an_extra_introspection_works_and_an_import_names_the_extra() -> None:
    """`help`, completion and mocks load each name in `dir`. Without the extra this must not fail, but an
    import must still print how to install the extra."""
    code = (
        "import inspect, sys; sys.modules['py_trees'] = None; import tci, tci.capabilities\n"
        "for one in (tci, tci.capabilities): print('Capability' in dict(inspect.getmembers(one)), end=' ')\n"
        "print()\n"
        "try: from tci.capabilities.behaviour_tree import BehaviourTree\n"
        "except tci.MissingExtraError as error: print(error)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.startswith("True True \na behaviour tree needs py_trees")
    assert "pip install" in said


PAGES = [*ROOT.glob("docs/*.md"), ROOT / "README.md"]


@pytest.mark.parametrize("path", [*sorted(ROOT.glob("examples/*.py")), *PAGES], ids=lambda path: path.name)
def test_examples_and_pages_use_public_names_only(path: Path) -> None:
    text, public = path.read_text(), public_objects()
    shown = [text] if path.suffix == ".py" else re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for code in shown:
        for package, names in re.findall(r"^\s*from (tci[\w.]*) import ([\w, ]+)$", code, re.MULTILINE):
            assert {f"{package}.{name}" for name in names.split(", ")} <= public.keys()
        for name in re.findall(r"(?<![\w/.\"'])(tci(?:\.\w+)+)", code):
            assert any(f"{one}.".startswith(f"{name}.") or name.startswith(f"{one}.") for one in public), name


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
