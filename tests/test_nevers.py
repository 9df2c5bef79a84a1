"""Design rules that no other test checks. Plain data, layers, reasons and options have separate tests."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

import tci
from tci.drivers.registry import driver_names
from tci.messages import JointReading, Reading
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position

ROOT = Path(tci.__file__).parent
FILES = {path.relative_to(ROOT).as_posix(): ast.parse(path.read_text()) for path in ROOT.rglob("*.py")}
MOST = 10
"""Largest number of a kernel's parameters."""


def kernels(tree: ast.Module) -> list[ast.FunctionDef]:
    """Returns the functions that numba compiles."""
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    marks = ("compiled(", "inlined")
    return [one for one in functions if any(ast.unparse(d).startswith(marks) for d in one.decorator_list)]


def drivers() -> dict[str, ast.ClassDef]:
    """Returns the classes derived from a driver, by file and name."""
    return {
        f"{file}:{node.name}": node
        for file, tree in FILES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
        and any(ast.unparse(base).endswith(("Driver", "DriverWrapper")) for base in node.bases)
    }


def test_no_kernel_has_more_than_ten_parameters() -> None:
    found = {
        f"{file}:{one.name}": len(one.args.args) for file, tree in FILES.items() for one in kernels(tree)
    }
    assert len(found) > 30
    assert not {name: count for name, count in found.items() if count > MOST}


def test_no_driver_skips_the_facts_of_its_connection() -> None:
    found = drivers()
    assert len(found) >= len(driver_names())
    own = {
        place: [one for one in node.body if getattr(one, "name", "") == "__init__"]
        for place, node in found.items()
    }
    silent = [
        place for place, inits in own.items() for one in inits if "super().__init__(" not in ast.unparse(one)
    ]
    assert not silent


@pytest.fixture(scope="module")
def renamed() -> Robot:
    """Returns a NAO whose parts have meaningless names."""
    nao = tci.load_robot("nao")
    names = {part.name: f"part_{number}" for number, part in enumerate(nao.parts)}
    parts = tuple(part.model_copy(update={"name": names[part.name]}) for part in nao.parts)
    patches = tuple(one.model_copy(update={"part": names[one.part]}) for one in nao.patches)
    return nao.model_copy(update={"parts": parts, "patches": patches})


def test_a_part_has_its_kind_whatever_its_name(renamed: Robot) -> None:
    body, nao = tci.GenericBody(renamed), tci.load_robot("nao")
    for part, before in zip(renamed.parts, nao.parts, strict=True):
        assert part.name in body.parts(before.kind)
    position = initial_position(renamed)
    joints = JointReading(0.0, 0, position, np.zeros(len(position)))
    orders = tci.WithdrawalReflex(mode="impedance").begin(
        tci.Perceiver(body).step(Reading(joints, ()), 0.0), body
    )
    assert {order.part for order in orders} == {"part_0", "part_1"} == {*body.parts("arm")}


def test_no_kind_is_told_from_a_number_of_joints() -> None:
    compared = {
        f"{file}:{node.lineno}"
        for file, tree in FILES.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Compare)
        and "servos)" in ast.unparse(node.left)
        and ast.unparse(node.left).startswith("len(part")
    }
    assert not compared
