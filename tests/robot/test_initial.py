"""Initial postures must satisfy the robot's limits and couplings, for every kind of joint transform."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tci.errors import DescriptionError
from tci.robot.catalogue import load_robot
from tci.robot.joint_map import initial_position
from tci.robot.xml import read_robot

TABLE = """<generic_robot version="1" name="bent" angle_unit="deg">
  <robot_part name="neck"><servo id="0" name="bent"><position min="{low}" max="{high}"/></servo></robot_part>
  <coupling name="cable" min="-10" max="10"><term robot_part="neck" servo="0" coefficient="1"/></coupling>
  <generic_robot_part name="head" kind="head" robot_part="neck">
    <generic_servo id="0">
      <destination_servo_id>0</destination_servo_id>
      <transform_type>table</transform_type>
      <transform_table><point robot="0" generic="90"/><point robot="45" generic="135"/></transform_table>
    </generic_servo>
    {initial}
  </generic_robot_part>
</generic_robot>
"""

COUPLED = """<generic_robot version="1" name="waist" angle_unit="deg">
  <robot_part name="waist">
    <servo id="0" name="a"><position min="-20" max="20"/></servo>
    <servo id="1" name="b"><position min="-20" max="20"/></servo>
  </robot_part>
  <coupling name="cable" min="{low}" max="{high}">
    <term robot_part="waist" servo="1" coefficient="1"/>
  </coupling>
  <generic_robot_part name="torso" kind="torso" robot_part="waist">
    <generic_servo id="0">
      <destination_servo_id>0</destination_servo_id>
      <transform_type>coupled</transform_type>
      <coupled_term destination_servo_id="0" factor="0.5"/>
      <coupled_term destination_servo_id="1" factor="0.5"/>
    </generic_servo>
    <generic_servo id="1">
      <destination_servo_id>1</destination_servo_id>
      <transform_type>coupled</transform_type>
      <coupled_term destination_servo_id="0" factor="0.5"/>
      <coupled_term destination_servo_id="1" factor="-0.5"/>
    </generic_servo>
    <initial_positions>
      <servo destination_servo_id="0" pos="{first}"/><servo destination_servo_id="1" pos="{second}"/>
    </initial_positions>
  </generic_robot_part>
</generic_robot>
"""


def faults(folder: Path, text: str) -> list[str]:
    path = folder / "robot.xml"
    path.write_text(text)
    try:
        read_robot(path)
    except DescriptionError as error:
        return [str(fault) for fault in error.faults]
    return []


def position(angle: float) -> str:
    return f'<initial_positions><servo destination_servo_id="0" pos="{angle}"/></initial_positions>'


def test_a_table_is_inverted(tmp_path: Path) -> None:
    assert faults(tmp_path, TABLE.format(low=-90, high=90, initial=position(90))) == []
    assert initial_position(read_robot(tmp_path / "robot.xml")) == pytest.approx([0.0])
    limit, cable = sorted(
        faults(tmp_path, TABLE.format(low=-20, high=20, initial=position(0))),
        key=lambda fault: "cable" in fault,
    )
    assert "puts servo 0 'bent' at -90 deg (transform_table), outside its -20 deg to 20 deg" in limit
    assert "valid generic angles: 70 deg to 110 deg" in limit
    assert "their sum is -90 deg, valid: -10 deg to 10 deg" in cable
    (cable,) = faults(tmp_path, TABLE.format(low=-90, high=90, initial=position(101)))
    assert "their sum is 11 deg" in cable


def test_the_default_is_looked_at_too(tmp_path: Path) -> None:
    found = faults(tmp_path, TABLE.format(low=-20, high=20, initial=""))
    assert any("no initial position, and the default 0 deg of generic servo 0" in fault for fault in found)


@pytest.mark.parametrize(
    ("first", "second", "cable", "expected"),
    [
        (10, 10, 5, []),  # a = 20, b = 0
        (15, 0, 20, []),  # both 15
        (15, 0, 5, ["break coupling 'cable': their sum is 15 deg"]),
        (11, 10, 20, ["coupled generic servos 0, 1 put servo 0 'a' at 21 deg, outside its -20 deg"]),
        (30, 10, 20, ["put servo 0 'a' at 40 deg"]),
    ],
)  # fmt: skip
def test_a_coupling_of_joints_is_inverted(
    tmp_path: Path, first: float, second: float, cable: float, expected: list[str]
) -> None:
    text = COUPLED.format(low=-cable, high=cable, first=first, second=second)
    found = faults(tmp_path, text)
    assert len(found) == len(expected), found
    assert all(words in fault for words, fault in zip(expected, found, strict=True))


def test_faulty_transforms_have_no_initial_posture(tmp_path: Path) -> None:
    text = COUPLED.format(low=-5, high=5, first=10, second=10)
    (singular,) = faults(tmp_path, text.replace('factor="-0.5"', 'factor="0.5"'))
    assert "can't be told apart" in singular
    text = TABLE.format(low=-20, high=20, initial=position(0))
    (points,) = faults(tmp_path, text.replace('<point robot="45" generic="135"/>', ""))
    assert "of 1 points" in points


@pytest.mark.parametrize("name", ["g1", "talos", "alex"])
def test_a_retargeted_shoulder_is_looked_at_with_its_model(tmp_path: Path, name: str) -> None:
    source = Path(load_robot(name).source)
    text = source.read_text()
    for file in source.parent.iterdir():
        if file != source:
            (tmp_path / file.name).symlink_to(file)
    assert faults(tmp_path, text) == []
    before = '<servo destination_servo_id="1" pos="25"/>'
    assert before in text
    (found, *_) = faults(tmp_path, text.replace(before, '<servo destination_servo_id="1" pos="-120"/>', 1))
    assert "the initial positions of the retargeted shoulder of 'left_arm' put servo" in found
    head = text[: text.index("<coupling") if "<coupling" in text else text.index("<generic_robot_part")]
    robot = load_robot(name)
    servo = robot.servos[robot.part("left_arm").servos[0].servo or 0]
    angle = np.rad2deg(initial_position(robot)[servo.index])
    cable = (
        f'<coupling name="cable" min="{angle + 1}" max="{angle + 2}">'
        f'<term robot_part="{servo.robot_part}" servo="{servo.id}" coefficient="1"/></coupling>\n  '
    )
    (found,) = faults(tmp_path, head + cable + text[len(head) :])
    assert "the initial positions break coupling 'cable': their sum is" in found
