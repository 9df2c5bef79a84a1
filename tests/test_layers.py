"""The architecture is a test: a module imports from layers to its left, and from its own folder."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import tci

ROOT = Path(tci.__file__).parent
WORDS = ("errors", "installed", "engine", "clock", "frames", "arrays", "compiled", "messages")
LAYERS = (
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
NEXT = {("drivers", "runtime"), ("pictures", "experiments")}
"""Arrows against the order that the move of the files left, each to be mended by its own commit."""
RANK = {**dict.fromkeys(WORDS, 0), **{name: rank for rank, name in enumerate(LAYERS, start=1)}}
MADE = "tci_lcm"
"""What lcm-gen made."""
MODULES = sorted(
    path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py" and MADE not in path.parts
)


def imported(path: Path) -> set[str]:
    """First word below `tci` of everything that a module imports, also inside functions."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module or "")
    return {name.split(".")[1] for name in names if name.startswith("tci.")}


def test_every_folder_has_a_layer() -> None:
    here = {path.stem for path in ROOT.iterdir() if path.is_dir() or path.suffix == ".py"}
    assert here - {"__init__", "__pycache__"} <= RANK.keys()


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_to_the_left(path: Path) -> None:
    own = path.relative_to(ROOT).parts[0].removesuffix(".py")
    wrong = {name for name in imported(path) if name != own and RANK[name] >= RANK[own]}
    wrong -= {after for before, after in NEXT if before == own}
    if own in WORDS:
        wrong -= set(WORDS)
    assert not wrong, f"{own} must not import {sorted(wrong)}"
