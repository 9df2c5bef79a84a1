"""Installation advice is read from the metadata of installed packages, and never names the package of another
project."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, PathDistribution
from pathlib import Path

import pytest

from helpers import ROOT
from tci.errors import MissingExtraError
from tci.support import installed
from tci.support.installed import advice, needs, own_distribution

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PAGES = [ROOT / "README.md", *(ROOT / "docs").glob("*.md"), *(ROOT / "examples").rglob("*.py")]
SOURCES = [path for path in (ROOT / "src").rglob("*") if path.suffix in (".py", ".xml", ".html")]
METADATA = """Metadata-Version: 2.4
Name: acme-robot
Version: 1.0
Provides-Extra: acme
Provides-Extra: elsewhere
Requires-Dist: acme-wire>=2 ; extra == 'acme'
Requires-Dist: acme-card ; sys_platform == 'none' and extra == 'elsewhere'
"""


@pytest.fixture
def acme(tmp_path: Path) -> PathDistribution:
    """Creates the metadata of another project's distribution, with one extra for every machine and one extra
    for none."""
    folder = tmp_path / "acme_robot-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(METADATA)
    return PathDistribution(folder)


def test_the_distribution_is_the_one_that_brings_the_command() -> None:
    point = EntryPoint("tci", PROJECT["scripts"]["tci"], "console_scripts")
    assert point.value == installed.OWN
    found = own_distribution()
    assert found is not None
    assert installed.OWN in {point.value for point in found.entry_points}


@pytest.mark.parametrize(
    ("files", "wrong"), [(PAGES, {"tci"}), (SOURCES, {"tci", PROJECT["name"]})], ids=["pages", "src"]
)
def test_nobody_is_told_to_install_anothers_package(files: list[Path], wrong: set[str]) -> None:
    """Pages may contain the name of the distribution. Programs must call `advice` to get the name."""
    for path in files:
        text = path.read_text()
        assert not set(re.findall(r"pip install\s+(?:-\S+\s+)*[\"']?([\w-]+)", text)) & wrong, path
        assert not re.search(r"\btci\\*\[[a-z]", text), path


def test_pages_name_extras_that_there_are() -> None:
    pages = "\n".join(path.read_text() for path in PAGES)
    named = re.findall(r"(?:tactile-capabilities|['\"]\.)\[([\w,]+)\]", pages)
    assert len(named) > 8
    extras = {extra for words in named for extra in words.split(",")} - {"EXTRA"}
    assert extras <= PROJECT["optional-dependencies"].keys()


def test_advice_is_of_the_distribution_that_lacks_something(acme: PathDistribution) -> None:
    assert advice("acme", of=acme) == "install it with: pip install 'acme-robot[acme]'"
    # TCI has no extra with this name
    assert advice("sim", of=acme) == "install it with: pip install acme-robot"
    assert "not made for this machine; valid: sys_platform == " in advice("elsewhere", of=acme)


def test_a_missing_module_names_itself_and_the_way_to_get_it(acme: PathDistribution) -> None:
    with (
        pytest.raises(
            MissingExtraError, match=r"^the driver 'acme' needs no_such_wire, .*'acme-robot\[acme\]'$"
        ),
        needs("the driver 'acme'", "acme", of=acme),
    ):
        import no_such_wire  # noqa: F401 - only the error of the import matters


def test_a_module_of_tci_that_is_missing_is_a_bug(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tci.messages.clock", None)
    with pytest.raises(ModuleNotFoundError), needs("a clock", "viewer"):
        import tci.messages.clock  # noqa: F401 - only the error of the import matters


@pytest.mark.parametrize(
    ("program", "first"),
    [
        ("import tci; tci.connect", "tci.errors.ClashError: "),
        ("from tci.simulation.world import World", "tci.errors.ClashError: "),
        ("import sys; sys.argv = ['tci', 'describe', 'nao']; from tci.cli.main import main; main()", "tci: "),
    ],
    ids=["program", "module", "command"],
)
def test_a_library_that_another_release_broke_is_told_with_the_cure(
    program: str, first: str, tmp_path: Path
) -> None:
    """mujoco-core 4 was installed over MuJoCo 3: `import mujoco` then loads a plugin of version 3, whose
    library is missing."""
    for name, version in (("mujoco", "3.17.0"), ("mujoco-core", "4.0.1")):
        folder = tmp_path / f"{name.replace('-', '_')}-{version}.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        (folder / "top_level.txt").write_text("mujoco\n")
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "__init__.py").write_text("raise OSError('libmujoco.so.3.17.0: cannot open')")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        f"{first}MuJoCo can't be loaded (libmujoco.so.3.17.0: cannot open): mujoco 3.17.0 and mujoco-core "
        "4.0.1 write into the same folder: the last one installed counts; pip install --force-reinstall "
        "--no-deps 'mujoco>=3.11,<4' serves TCI and what needs MuJoCo 3"
    )


def test_a_folder_that_was_never_installed_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installed, "entry_points", lambda **_: ())
    assert advice("icub") == "TCI itself is not installed: run pip install . in its folder"
