"""mjlab's sensor contains what it needs of TCI, and it is what TCI has. That it feels the same is shown by
`make mjlab`, in an environment with mjlab's own MuJoCo."""

from __future__ import annotations

import ast
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

import tci
from helpers.command_line import tci as run
from tci.batch import skin_to_json
from tci.errors import TciError
from tci.exports import query
from tci.robot.catalogue import load_robot
from tci.simulation import kernel, sampling

ROOT = Path(tci.__file__).parent
PACKAGE = ROOT.parents[1] / "packages" / "mjlab_tci"
FEEL = ROOT / "batch" / "feel.py"
OTHERS = re.compile(r"^\s*(import|from) (mjlab|torchrunx)", re.MULTILINE)


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add((node.module or "").split(".")[0])
    return names


def test_neither_imports_the_other() -> None:
    own = [FEEL, *(PACKAGE / "mjlab_tci").glob("*.py")]
    assert len(own) >= 6
    for path in own:
        assert not imported(path) & {"tci", "yarpwire", "numba"}, path
    assert imported(FEEL) == {"__future__", "typing", "warp"}
    for path in ROOT.rglob("*.py"):
        assert not OTHERS.search(path.read_text()), path


def test_mjlab_finds_the_task_and_the_kernel() -> None:
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())
    module = project["project"]["entry-points"]["mjlab.tasks"]["tci"]
    assert (PACKAGE / module.replace(".", "/")).with_suffix(".py").exists()
    included = project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    assert {(PACKAGE / source).resolve(): to for source, to in included.items()} == {
        FEEL: "mjlab_tci/feel.py"
    }


def test_the_kernel_has_the_constants_of_the_loops() -> None:
    """Read from its text: Warp is an extra."""
    found = {}
    for node in ast.parse(FEEL.read_text()).body:
        if isinstance(node, ast.Assign):
            targets = node.targets[0]
            names = targets.elts if isinstance(targets, ast.Tuple) else [targets]
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            for name, value in zip(names, values, strict=True):
                if isinstance(value, ast.Call) and ast.unparse(value.func) == "wp.constant":
                    found[ast.unparse(name)] = ast.literal_eval(value.args[0])
    assert found.pop("SLACK") < kernel._TOLERANCE
    assert found == {
        "SLOTS": sampling.SLOTS, "NUMBERS": sampling.NUMBERS, "AT_FORCE": sampling.FORCE,
        "AT_POSITION": sampling.POSITION, "AT_NORMAL": sampling.NORMAL, "REACH": kernel.REACH,
        "SIDE": sampling.SIDE, "SOFTNESS": kernel._SOFTNESS, "TOLERANCE": kernel._TOLERANCE,
        "STEPS": kernel._STEPS,
    }  # fmt: skip


def test_the_package_has_the_skin_of_todays_g1() -> None:
    assert (PACKAGE / "mjlab_tci" / "g1.json").read_text() == skin_to_json("g1"), (
        "made anew by: tci skin export g1 --to json --out packages/mjlab_tci/mjlab_tci/g1.json"
    )


def test_the_file_has_the_taxels_of_the_robot(tmp_path: Path) -> None:
    run("skin", "export", "nao", "--to", "json", "--out", str(tmp_path / "nao.json"))
    found = json.loads((tmp_path / "nao.json").read_text())
    facts = {one.name: one for one in query("nao").patches}
    assert found["format"] == "tci.skin/1"
    assert {one["name"] for one in found["patches"]} == set(facts)
    for one in found["patches"]:
        taxels, solid = facts[one["name"]].taxels, np.array(one["solid"])
        assert one["link"] == facts[one["name"]].link
        positions = np.array([taxel.position for taxel in taxels])
        normals = np.array([taxel.normal for taxel in taxels])
        assert np.abs(np.array(one["positions"]) - positions).max() <= 1e-8
        assert np.abs(np.array(one["normals"]) - normals).max() <= 1e-8
        # What is touched reaches every taxel, and not beyond its own size.
        reach = np.linalg.norm(solid[:, None] - positions[None], axis=2)
        assert reach.min(axis=1).max() <= 0.01
        assert reach.min(axis=0).max() <= 0.01


def test_skin_that_the_kernel_can_not_feel_is_refused() -> None:
    nao = load_robot("nao")
    rigid = nao.patches[0].model_copy(update={"rigid": True})
    with pytest.raises(TciError, match="rigid plate; valid: soft skin"):
        skin_to_json(nao.model_copy(update={"patches": (rigid,)}))
    with pytest.raises(TciError, match="no taxels"):
        skin_to_json(nao.model_copy(update={"patches": ()}))
