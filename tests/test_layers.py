"""Tests the architecture: modules import only from lower layers, and no files import each other in a
circle."""

from __future__ import annotations

import ast
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import tci

ROOT = Path(tci.__file__).parent
LAYERS = (
    "errors reasons",
    "support",
    "messages",
    "robot",
    "skin",
    "joint_touch",
    "gate",
    "body",
    "touches",
    "gestures",
    "capabilities",
    "exports",
    "simulation",
    "recording",
    "drivers",
    "testing",
    "runtime",
)
"""Folders and files of the core in layers, from the bottom to the top. Files of one layer may import each
other."""
PLUGS = ("shared", "wires", "sources", "datasets", "batch", "learn")
"""What plugs into the core: each may import the core, and a wire or a source also `shared`."""
TOP = "lab", "cli"
"""May import everything below; `lab` must not import `cli`."""
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer.split()}
GENERATED = "tci_lcm"
"""Folder of code that lcm-gen generated."""
WIRE = ROOT.parent / "yarpwire"
"""Package that must not import TCI."""


def module_of(path: Path) -> str:
    """Returns the dotted name of a file of either package."""
    return ".".join(path.relative_to(ROOT.parent).with_suffix("").parts).removesuffix(".__init__")


MODULES = {
    module_of(path): path
    for path in sorted(ROOT.rglob("*.py"))
    if path != ROOT / "__init__.py" and GENERATED not in path.parts
}
WIRE_MODULES = {module_of(path): path for path in sorted(WIRE.rglob("*.py")) if path != WIRE / "__init__.py"}


@cache
def imported(path: Path) -> set[str]:
    """Returns the modules that a file imports. Includes imports inside functions and imports for types
    only."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            inner = {f"{module}.{alias.name}" for alias in node.names}
            names |= {name if name in MODULES or name in WIRE_MODULES else module for name in inner}
    return names


def folders(name: str) -> set[str]:
    """Folders of `tci` from which a module imports, without its own."""
    others = {other.split(".")[1] for other in imported(MODULES[name]) if other.startswith("tci.")}
    return others - {name.split(".")[1]}


def test_every_folder_has_a_group() -> None:
    here = {path.stem for path in ROOT.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert here - {"__init__", "__pycache__"} == {*RANK, *PLUGS, *TOP}


def test_the_page_shows_the_same_layers() -> None:
    page = (ROOT.parents[1] / "docs" / "architecture.md").read_text()
    shown = page.split("```text\n")[1].split("```")[0].replace("\n", " ")
    assert [name for layer in shown.split("|") for name in layer.split()] == [*RANK, *PLUGS, *TOP]


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[1] in RANK])
def test_the_core_imports_lower_layers_only(name: str) -> None:
    own = RANK[name.split(".")[1]]
    wrong = {one for one in folders(name) if RANK.get(one, 99) > own or (RANK[one] == own != 0)}
    assert not wrong, f"{name} must not import {sorted(wrong)}"


def test_the_public_names_come_from_the_core() -> None:
    """Only `tci.film` draws, with the pictures of the lab."""
    names = imported(ROOT / "__init__.py") - {"tci.lab.pictures.film"}
    assert {name.split(".")[1] for name in names if name.startswith("tci.")} <= RANK.keys()


@pytest.mark.parametrize("name", [name for name in MODULES if name.split(".")[1] in PLUGS])
def test_plugs_import_the_core_and_what_they_share(name: str) -> None:
    shared = {"shared"} if name.startswith(("tci.wires.", "tci.sources.")) else set()
    assert folders(name) <= RANK.keys() | shared


@pytest.mark.parametrize(
    "name", [name for name in MODULES if name.startswith(("tci.wires.", "tci.sources."))]
)
def test_wires_and_sources_do_not_import_each_other(name: str) -> None:
    group = ".".join(name.split(".")[:2]) + "."
    others = {other.split(".")[2] for other in imported(MODULES[name]) if other.startswith(group)}
    assert others <= {name.split(".")[2]}


@pytest.mark.parametrize("name", [name for name in MODULES if name.startswith("tci.lab.")])
def test_the_lab_does_not_import_the_command_line(name: str) -> None:
    assert "cli" not in folders(name)


@pytest.mark.parametrize("name", ["yarpwire", *WIRE_MODULES])
def test_yarpwire_needs_numpy_and_nothing_of_tci(name: str) -> None:
    packages = {other.split(".")[0] for other in imported(WIRE_MODULES.get(name, WIRE / "__init__.py"))}
    assert packages - sys.stdlib_module_names <= {"yarpwire", "numpy"}


@pytest.mark.parametrize("modules", [MODULES, WIRE_MODULES], ids=["tci", "yarpwire"])
def test_no_files_import_each_other_in_a_circle(modules: dict[str, Path]) -> None:
    graph = {name: imported(path) & modules.keys() - {name} for name, path in modules.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def folder_of(name: str, modules: dict[str, Path]) -> str:
    """Returns the folder of a module. For a file that lies directly in a package with subfolders, returns the
    file itself."""
    inside = name.count(".") > 1 and modules[name].name != "__init__.py"
    return name.rpartition(".")[0] if inside else name


@pytest.mark.parametrize("modules", [MODULES, WIRE_MODULES], ids=["tci", "yarpwire"])
def test_no_folders_import_each_other_in_a_circle(modules: dict[str, Path]) -> None:
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        own = folder_of(name, modules)
        others = {folder_of(other, modules) for other in imported(path) & modules.keys()}
        # Imports of a subfolder from its parent folder stay within one concept.
        graph.setdefault(own, set()).update(one for one in others if not f"{own}.".startswith(f"{one}."))
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_yarpwire_does_not_import_the_bindings_that_stand_on_it() -> None:
    below = {name for name in WIRE_MODULES if not name.startswith("yarpwire.bindings")}
    assert not [name for name in below if any("bindings" in one for one in imported(WIRE_MODULES[name]))]
