"""Worlds on a GPU: what TCI says without mujoco-warp, and the tests of `on_warp.py` with it."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

import tci.batch
import tci.simulation.stepping  # before a test changes the version by which it finds the library
from helpers import ROOT
from helpers.peers import peer_python
from tci.errors import ClashError, MissingExtraError
from tci.support.engine import mujoco


def test_another_mujoco_is_told_at_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mujoco, "__version__", "3.17.0")
    monkeypatch.delitem(sys.modules, "tci.batch.gpu", raising=False)
    with pytest.raises(ClashError, match=r"MuJoCo 3\.17\.0 lies over it.*valid: pip install"):
        tci.batch.make_worlds("nao", 1, engine="warp")


@pytest.mark.skipif(importlib.util.find_spec("mujoco_warp") is not None, reason="mujoco-warp is there")
def test_a_missing_extra_is_told() -> None:
    with pytest.raises(MissingExtraError, match="mujoco_warp"):
        tci.batch.make_worlds("nao", 1, engine="warp")


def test_worlds_on_the_cpu_device_of_warp_equal_those_of_mujoco_batch() -> None:
    """In a process of its own, beside TCI's MuJoCo. The first run compiles for two minutes."""
    environment = ROOT / ".peers" / "warp"
    (packages,) = environment.glob("lib/python*/site-packages") if peer_python("warp") else ()
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    own["PYTHONPATH"] = os.pathsep.join([*filter(None, [own.get("PYTHONPATH")]), str(packages)])
    own["WARP_CACHE_PATH"] = str(environment / "kernels")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--durations", "0"]
    ran = subprocess.run(
        [*command, str(Path(__file__).with_name("on_warp.py"))], env=own, cwd=ROOT, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    print(ran.stdout[-20_000:])
    assert ran.returncode == 0, ran.stderr[-2000:]
