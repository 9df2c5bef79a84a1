"""What a user pays for `import tci` and `tci --help`: nothing heavier than NumPy."""

from __future__ import annotations

import subprocess
import sys

import pytest
from typer.testing import CliRunner

import tci
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


@pytest.mark.parametrize("name", dir(tci))
def test_every_public_name_exists(name: str) -> None:
    assert getattr(tci, name) is not None


def test_the_command_tells_its_version() -> None:
    done = CliRunner().invoke(app, ["--version"])
    assert (done.exit_code, done.output) == (0, f"tci {tci.__version__}\n")


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no_such_name"):
        _ = tci.no_such_name
