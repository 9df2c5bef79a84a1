"""Results that are computed once per robot are stored outside of its description, and are released with the
robot."""

from __future__ import annotations

import gc
import pickle
import shutil
import weakref
from pathlib import Path

import numpy as np
import pytest

import tci
from tci.robot import catalogue, xml
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position, joint_map, postures
from tci.robot.kinematics import KinematicChain
from tci.robot.per_robot import per_robot


def test_a_result_is_computed_once_for_each_robot_and_other_arguments() -> None:
    made: list[tuple[str, int]] = []

    @per_robot
    def count(robot: Robot, number: int) -> int:
        made.append((robot.name, number))
        return len(made)

    one = tci.load_robot("nao")
    same = one.model_copy()
    assert one == same
    assert [count(one, 1), count(one, 1), count(one, 2), count(same, 1), count(one, 1)] == [1, 1, 2, 3, 1]


@pytest.mark.parametrize("name", ["nao", "icub-whole"])
def test_what_is_computed_of_a_robot_is_released_with_it_and_no_part_of_its_pickle(name: str) -> None:
    # other objects may still refer to the robot that `load_robot` returns for this name
    robot = tci.load_robot(name).model_copy()
    generic = postures(robot).to_generic(initial_position(robot))
    for part in robot.parts:
        assert np.array_equal(
            joint_map(robot, part.name).to_generic(initial_position(robot)), generic[part.name]
        )
    assert b"joint_map" not in pickle.dumps(robot)
    gone = weakref.ref(robot)
    del robot, part
    gc.collect()
    assert gone() is None


def test_a_name_stands_for_one_object_until_its_description_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, other = tci.load_robot("nao"), tci.load_robot("nao-h21")
    assert tci.load_robot("nao") is robot
    monkeypatch.setattr(catalogue, "_packaged", lambda: {"nao": Path(other.source)})
    assert tci.load_robot("nao") == other
    monkeypatch.undo()
    assert tci.load_robot("nao") == robot


@pytest.mark.parametrize("file", ["left_sole.csv", "nao.mjcf.xml", "robot.xml"])
def test_a_changed_file_gives_a_new_object(
    file: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """In an earlier version `load_robot` returned the robot in use, with the skin and the geometry of the
    earlier files."""
    folder = shutil.copytree(Path(tci.load_robot("nao").source).parent, tmp_path / "nao")
    text = (folder / "robot.xml").read_text()
    assert file in (folder / "whole.xml").read_text() + text
    monkeypatch.setattr(catalogue, "_packaged", lambda: {"nao-whole": folder / "whole.xml"})
    robot = tci.load_robot("nao-whole")
    assert tci.load_robot("nao-whole") is robot
    changed = folder / file
    changed.write_text(changed.read_text() + "\n")
    assert tci.load_robot("nao-whole") is not robot


def test_skin_is_built_once_for_each_robot_and_released_with_it() -> None:
    robot = tci.load_robot("nao").model_copy()
    first, second = tci.GenericBody(robot), tci.GenericBody(robot)
    assert second.layout is first.layout
    for name, surface in first.skin.surfaces.items():
        assert second.skin.surfaces[name] is surface
    other = tci.GenericBody(robot.model_copy())
    assert other.layout is not first.layout
    gone = weakref.ref(robot)
    del robot, first, second
    gc.collect()
    assert gone() is None


def test_chains_of_one_robot_share_what_they_compute() -> None:
    """A gate needs four, and a body three: the tables were most of the time in which a gate was made."""
    robot = tci.load_robot("icub").model_copy()
    first, second = KinematicChain(robot), KinematicChain(robot)
    assert second.steps is first.steps
    assert second.sums is first.sums
    assert KinematicChain(robot.model_copy()).steps is not first.steps
    gone = weakref.ref(robot)
    del robot
    gc.collect()
    assert gone() is None


def test_a_second_load_by_name_reads_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = weakref.ref(tci.load_robot("nao"))
    gc.collect()
    monkeypatch.setattr(xml, "read_robot", lambda _: pytest.fail("read again"))
    assert tci.load_robot("nao") is robot()
