"""The catalogue of faults, its page, and the tests that it names are consistent."""

from __future__ import annotations

import ast

import pytest

from helpers import ROOT
from tci.lab.faults.fault_list import FAULTS, KnownFault
from tci.lab.faults.injectors import INJECTORS

PAGE = ROOT / "docs" / "reliability.md"


def row(known: KnownFault) -> str:
    """Returns the fault's line in the table of the page."""
    shown = f"open: {known.missing}" if known.missing else f"`{known.test}`"
    return f"| {known.number} | {known.fault} | {known.expected} | {shown} |"


def test_the_catalogue_has_58_faults_each_tested_or_open() -> None:
    assert list(FAULTS) == list(range(1, 59))
    assert all(bool(known.test) != bool(known.missing) for known in FAULTS.values())


@pytest.mark.parametrize("known", [k for k in FAULTS.values() if k.test], ids=lambda known: str(known.number))
def test_each_test_that_is_named_exists(known: KnownFault) -> None:
    path, _, name = known.test.partition("::")
    tree = ast.parse((ROOT / path).read_text())
    assert name in {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


@pytest.mark.parametrize("known", FAULTS.values(), ids=lambda known: str(known.number))
def test_the_page_says_what_the_catalogue_says(known: KnownFault) -> None:
    assert row(known) in PAGE.read_text().splitlines()


def test_injectors_name_known_faults() -> None:
    assert {kind.number for kind in INJECTORS.values()} <= FAULTS.keys()
    assert all(kind.description for kind in INJECTORS.values())


def test_57_nothing_unsafe_is_imported() -> None:
    unsafe = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal", "yaml"}
    # the cache holds machine code, which its reader runs anyway, in a folder that only the user may write to
    cache = ROOT / "src" / "tci" / "support" / "compiled.py"
    for path in {*(ROOT / "src").rglob("*.py")} - {cache}:
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            assert not unsafe & {name.split(".")[0] for name in names}, path
