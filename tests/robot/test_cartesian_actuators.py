"""The XML element `cartesian_actuator`: reading, writing, and errors for meaningless values."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.robot.catalogue import load_robot
from tci.robot.description import USUAL_ACTUATORS
from tci.robot.xml import read_robot
from tci.robot.xml.writer import write_robot

PALM = 'name="palm" link="LHand" xyz="0.05775 0 -0.01231" frame="torso" speed="0.5"'


def nao_with(folder: Path, actuator: str, *, part: str = "left_arm") -> Path:
    """Returns a description that adds a Cartesian actuator to a part of the NAO."""
    own = Path(load_robot("nao").source)
    path = folder / "robot.xml"
    text = re.sub(r'\s*<cartesian_actuator name="palm"[^>]*>', "", own.read_text(encoding="utf-8"))
    head, found, tail = text.partition(f'<generic_robot_part name="{part}"')
    body, end, rest = tail.partition("</generic_robot_part>")
    path.write_text(f"{head}{found}{body}<cartesian_actuator {actuator}/>{end}{rest}", encoding="utf-8")
    for beside in own.parent.iterdir():
        if beside.suffix in (".csv",) or beside.name.endswith(".mjcf.xml"):
            (folder / beside.name).write_bytes(beside.read_bytes())
    return path


def test_an_actuator_of_any_part_is_read_and_one_named_hand_replaces_the_usual(tmp_path: Path) -> None:
    robot = read_robot(
        nao_with(tmp_path, 'name="eyes" link="Head" xyz="0.05 0 0.06" frame="torso"', part="head")
    )
    (eyes,) = robot.part("head").cartesian
    assert (eyes.name, eyes.link, eyes.xyz, eyes.frame) == ("eyes", "Head", (0.05, 0.0, 0.06), "torso")
    assert (eyes.speed, eyes.tolerance) == (None, 1e-3)
    assert robot.part("left_arm").cartesian == USUAL_ACTUATORS
    own = read_robot(nao_with(tmp_path, 'name="hand" segment="forearm" u="0.5" tolerance="0.004"'))
    hand, elbow = own.part("left_arm").cartesian
    assert (hand.name, hand.segment, hand.u, hand.tolerance) == ("hand", "forearm", 0.5, 0.004)
    assert elbow == USUAL_ACTUATORS[1]


@pytest.mark.parametrize(
    ("actuator", "part", "words"),
    [
        (PALM.replace("LHand", "LHond"), "left_arm", "the model has no link 'LHond'"),
        ('name="palm" frame="torso"', "left_arm", "one link, or on the axis of one segment"),
        (PALM + ' segment="forearm"', "left_arm", "one link, or on the axis of one segment"),
        (
            'name="palm" segment="finger"',
            "left_arm",
            "no segment 'finger' of an arm; valid: upper_arm, forearm",
        ),
        ('name="eyes" link="Head"', "head", "counts from a shoulder, which 'head' lacks"),
        (PALM.replace('"0.5"', '"0"'), "left_arm", "a number above 0 [m/s]"),
        (PALM.replace('"torso"', '"world"'), "left_arm", "valid: shoulder, torso"),
        (PALM + "/><cartesian_actuator " + PALM, "left_arm", "palm"),
    ],
)
def test_one_that_makes_no_sense_is_a_fault_with_its_line(
    tmp_path: Path, actuator: str, part: str, words: str
) -> None:
    path = nao_with(tmp_path, actuator, part=part)
    with pytest.raises(DescriptionError) as caught:
        read_robot(path)
    (fault,) = caught.value.faults
    assert words in fault.message
    assert "cartesian_actuator" in path.read_text().splitlines()[fault.line - 1]


def test_a_written_description_has_what_is_not_usual(tmp_path: Path) -> None:
    robot = read_robot(nao_with(tmp_path, PALM))
    less = {"patches": (), "parts": (robot.part("left_arm"),), "couplings": ()}
    bindings = tuple(one.model_copy(update={"addresses": ()}) for one in robot.bindings)  # of what is gone
    simple = robot.model_copy(update={**less, "bindings": bindings})
    text = write_robot(simple, file="nao.mjcf.xml")
    assert text.count("<cartesian_actuator") == 1
    (tmp_path / "robot.xml").write_text(text, encoding="utf-8")
    assert read_robot(tmp_path / "robot.xml").part("left_arm").cartesian == robot.part("left_arm").cartesian


def test_eyes_are_read_and_written_and_belong_to_a_head(tmp_path: Path) -> None:
    robot = load_robot("nao")
    eyes = robot.part("head").eyes
    assert eyes is not None
    assert (eyes.link, eyes.xyz) == ("Head", (0.05871, 0.0, 0.06364))
    assert (eyes.fov, eyes.pitch) == pytest.approx(np.deg2rad([47.64, 1.2]))
    written = '<eyes link="Head" xyz="0.05871 0 0.06364" fov="47.64" pitch="1.2"/>'
    assert written in write_robot(robot, file="nao.mjcf.xml")
    path = nao_with(tmp_path, PALM)
    text = path.read_text(encoding="utf-8").replace(f"<cartesian_actuator {PALM}/>", '<eyes link="Hed"/>')
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DescriptionError) as caught:
        read_robot(path)
    words = [fault.message for fault in caught.value.faults]
    assert any("'left_arm' has eyes and is no head" in one for one in words)
    assert any("the model has no link 'Hed'" in one for one in words)
