"""The architecture is a test: modules import from layers to their left, and no files form a circle."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import tci

ROOT = Path(tci.__file__).parent
LAYERS = (
    "errors installed clock frames compile_ahead compiled engine",
    "messages",
    "rosmsg",
    "robot",
    "skin",
    "gate",
    "body",
    "testing",
    "gestures",
    "capabilities",
    "exports",
    "simulation",
    "recording",
    "drivers",
    "runtime",
    "pictures",
    "authoring",
    "experiments",
    "learning",
    "commissioning",
    "viewer",
    "cli",
)
"""Files and folders of `tci` from the bottom to the top; those of one layer may import each other."""
RANK = {name: rank for rank, layer in enumerate(LAYERS) for name in layer.split()}
GENERATED = "tci_lcm"
"""Folder of code that lcm-gen made."""
MODULES = {
    ".".join(("tci", *path.relative_to(ROOT).with_suffix("").parts)).removesuffix(".__init__"): path
    for path in sorted(ROOT.rglob("*.py"))
    if path != ROOT / "__init__.py" and GENERATED not in path.parts
}


def imported(path: Path) -> set[str]:
    """Modules of `tci` that a file imports, also inside functions and for types only."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            inner = {f"{module}.{alias.name}" for alias in node.names}
            names |= {name if name in MODULES else module for name in inner}
    return {name for name in names if name.startswith("tci.")}


def test_every_folder_has_a_layer() -> None:
    here = {path.stem for path in ROOT.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert here - {"__init__", "__pycache__"} == RANK.keys()


@pytest.mark.parametrize("name", MODULES)
def test_imports_point_to_the_left(name: str) -> None:
    own = name.split(".")[1]
    others = {other.split(".")[1] for other in imported(MODULES[name])} - {own}
    wrong = {other for other in others if RANK[other] > RANK[own] or (RANK[other] == RANK[own] != 0)}
    assert not wrong, f"{name} must not import {sorted(wrong)}"


def test_no_files_import_each_other_in_a_circle() -> None:
    graph = {name: imported(path) & MODULES.keys() - {name} for name, path in MODULES.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))
