"""Worlds of one robot without people have copies of one model, each its own."""

from __future__ import annotations

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from tci.robot.catalogue import load_robot
from tci.simulation import scene
from tci.simulation.touch import FINGER_TIP
from tci.simulation.world import World


def test_the_next_world_builds_nothing_and_has_a_model_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot("nao")
    first = World(robot)
    friction, step = np.array(first.model.geom_friction), first.model.opt.timestep
    first.model.geom_friction[:] *= 2.0
    first.model.opt.timestep = 0.5
    first.advance(0.01)
    monkeypatch.setattr(scene, "solid_spec", lambda *_, **__: pytest.fail("built again"))
    second = World(robot)
    np.testing.assert_array_equal(second.model.geom_friction, friction)
    assert second.model.opt.timestep == step
    monkeypatch.undo()
    assert World(robot, tip=0.02).model.geom(FINGER_TIP).size[0] != second.model.geom(FINGER_TIP).size[0]


def test_a_model_that_was_written_again_is_built_again(tmp_path: Path) -> None:
    folder = copytree(Path(load_robot("nao").source).parent, tmp_path / "nao")
    robot = load_robot(folder / "robot.xml")
    assert robot.model is not None
    model, bodies = Path(robot.model.path), World(robot).model.nbody
    joint = '<joint name="HeadYaw"'
    model.write_text(model.read_text().replace(joint, '<body name="new"/>' + joint, 1))
    assert World(robot).model.nbody == bodies + 1
