"""Robot descriptions: valid descriptions load, and every fault causes one clear message with its line
number."""

from __future__ import annotations

import os
import random
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

import tci.robot
from helpers import ROOT
from helpers.xml_sample import GOOD, damage
from tci.errors import DescriptionError, MissingExtraError, TciError
from tci.robot.xml import read_robot, schema_path
from tci.robot.xml.element import Element
from tci.robot.xml.grammar import GENERIC_ROBOT
from tci.robot.xml.schema import schema_text, table_text
from tci.support.installed import advice

LISTING_2 = """<?xml version="1.0"?>
<generic_robot angle_unit="deg">
  <generic_robot_part name="icub_head">
    <generic_servo_number>2</generic_servo_number>
    <generic_servo id="0">
      <destination_servo_id>0</destination_servo_id>
      <transform_factor>1.00</transform_factor> <transform_displacement>0.00</transform_displacement>
      <stiffness>1.00</stiffness> <damping>0.00</damping> <speed>20.00</speed>
    </generic_servo>
    <generic_servo id="1">
      <destination_servo_id>2</destination_servo_id>
      <transform_factor>1.00</transform_factor> <transform_displacement>0.00</transform_displacement>
      <stiffness>1.00</stiffness> <damping>0.00</damping> <speed>20.00</speed>
    </generic_servo>
    <initial_positions>
      <servo type="deg" destination_servo_id="0" pos="-2.00"/>
      <servo type="deg" destination_servo_id="1" pos="15.00"/>
    </initial_positions>
  </generic_robot_part>
</generic_robot>
"""

AS_PRINTED = """<Generic_Robot_Part>icub_head</Generic_Robot_Part>
  <generic_servo_number>2</generic_servo_number>
<initial_positions>
  <servo type="deg" destination_servo_id="0" pos="-2.00"/>
</initial_postions>
"""


def write(folder: Path, text: str | bytes) -> Path:
    path = folder / "robot.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def faults(folder: Path, text: str | bytes) -> list[str]:
    with pytest.raises(DescriptionError) as caught:
        read_robot(write(folder, text))
    return [str(fault) for fault in caught.value.faults]


def changed(old: str, new: str) -> str:
    assert GOOD.count(old) >= 1, old
    return GOOD.replace(old, new, 1)


NAO = Path(tci.robot.__path__[0]) / "robots" / "nao" / "robot.xml"
WORD = re.compile(r"(?<=[ \n])\w+(?==\")|(?<=<)\w+(?=[^<>]*/>)")
"""Pattern of the name of an attribute, or of an element without content."""


def nao() -> str:
    """Returns the description of a NAO without its model, because the model needs other files."""
    return re.sub("<model .*>", "", NAO.read_text())


def misspelt() -> list[str]:
    """Returns copies of a NAO's description with one misspelt word, for each word in each element that
    contains it."""
    text = nao()
    found: dict[tuple[str, str], str] = {}
    for word in WORD.finditer(text, text.index("<robot_part")):
        begin, end = word.span()
        wrong = word[0][:1] + word[0][2:] if end - begin > 3 else word[0] + "x"
        tag = text[text.rindex("<", 0, end) : end].split()[0]
        found.setdefault((tag, word[0]), text[:begin] + wrong + text[end:])
    return [*found.values()]


def test_a_misspelt_word_is_one_fault_without_its_consequences(tmp_path: Path) -> None:
    texts = misspelt()
    for table in NAO.parent.glob("*.csv"):
        shutil.copy(table, tmp_path)
    assert len(texts) > 40
    for text in texts:
        found = faults(tmp_path, text)
        assert len(found) == 1, found
        assert "did you mean" in found[0]


def test_a_wrong_unit_is_one_fault_that_counts_its_consequences(tmp_path: Path) -> None:
    for table in NAO.parent.glob("*.csv"):
        shutil.copy(table, tmp_path)
    (found,) = faults(tmp_path, nao().replace('angle_unit="deg"', 'angle_unit="rad"'))
    assert "angle_unit of <generic_robot> is 'rad', in which 61 of 136 angles are implausible" in found
    assert found.endswith('valid: angle_unit="deg"')


def test_one_wrong_angle_of_few_is_no_wrong_unit(tmp_path: Path) -> None:
    """In an earlier version one implausible angle of three caused a message about a wrong unit of the whole
    file."""
    joint = '<servo id="0" name="a"><position min="-1" max="{}"/><velocity max="2"/></servo>'
    text = (
        '<?xml version="1.0"?>\n<generic_robot version="1" name="few" angle_unit="rad">\n'
        f'<robot_part name="A">{joint.format(90)}</robot_part>\n</generic_robot>'
    )
    found = " ".join(faults(tmp_path, text))
    assert "implausible in rad" in found
    assert "angle_unit of" not in found


def test_units_become_si_and_everything_is_read(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, GOOD))
    a, b, c = robot.part("head").servos
    assert (a.servo, b.servo, c.servo) == (1, 2, None)
    assert a.scale == -2.0
    np.testing.assert_allclose([a.offset, a.initial, c.fixed], [np.pi / 2, 1.0, np.deg2rad(12)])
    np.testing.assert_allclose(a.speed, np.deg2rad(20))
    assert (a.stiffness, a.damping) == (0.5, 0.1)
    assert robot.servos[1].limits.assumed == ("jerk",)
    np.testing.assert_allclose(robot.servos[1].limits.upper, np.deg2rad(80))
    assert robot.couplings[0].coefficients == (1.0, -1.0)
    assert len(robot.digest) == 64
    assert robot.binding("other").address("Neck", "usual") == "/neck"
    assert robot.binding("sim").address("Neck", "usual") == "usual"


def test_listing_2_mended_loads_as_it_stands(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, LISTING_2))
    part = robot.part("icub_head")
    assert part.kind == "other"
    assert [robot.servos[servo.servo or 0].id for servo in part.servos] == [0, 2]
    np.testing.assert_allclose(np.rad2deg(part.initial_posture), [-2, 15])


def test_kind_and_side_of_a_part_are_given_and_not_guessed_from_its_name(tmp_path: Path) -> None:
    robot = read_robot(write(tmp_path, changed('name="head"', 'name="left_arm"')))
    assert (robot.parts[0].kind, robot.parts[0].side) == ("other", None)
    robot = read_robot(write(tmp_path, changed('name="head"', 'name="left_arm" kind="head" side="right"')))
    assert (robot.parts[0].kind, robot.parts[0].side) == ("head", "right")


def test_listing_2_as_printed_is_not_well_formed(tmp_path: Path) -> None:
    assert any("line" in fault for fault in faults(tmp_path, AS_PRINTED))
    wrong_tag = LISTING_2.replace("</initial_positions>", "</initial_postions>")
    assert any("line 18" in fault for fault in faults(tmp_path, wrong_tag))


def test_ids_that_count_from_one_are_refused(tmp_path: Path) -> None:
    text = LISTING_2.replace('<generic_servo id="1">', '<generic_servo id="2">')
    text = text.replace('<generic_servo id="0">', '<generic_servo id="1">')
    assert any("count up from 0" in fault for fault in faults(tmp_path, text))


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        (' angle_unit="deg"', "", 2, "angle_unit"),
        ('angle_unit="deg"', 'angle_unit="degrees"', 2, "deg"),
        ('min="-90"', 'min="nan"', 4, "nan"),
        ('min="-90"', 'min="-inf"', 4, "inf"),
        ('min="-90"', 'min="-9_0"', 4, "9_0"),
        ('min="-90"', 'min="-\u0669\u0660"', 4, "finite decimal"),
        ('min="-90"', 'min="0x10"', 4, "0x10"),
        ('min="-90" max="90"', 'min="90" max="-90"', 4, "90"),
        ('min="-90" max="90"', 'min="-9000" max="9000"', 4, "9000"),
        ('<velocity max="200"/>', '<velocity max="0"/>', 4, "0"),
        ('<jerk max="9000"', '<jerk max="-1"', 5, "-1"),
        ('<servo id="1" name="roll">', '<servo id="0" name="roll">', 5, "id 0"),
        ('<servo id="1" name="roll">', '<servo id="1" name="pitch">', 5, "pitch"),
        (">-2<", ">0<", 15, "0.001"),
        (">-2<", ">1e-300<", 15, "0.001"),
        (">-2<", ">2000<", 15, "1000"),
        (">-2<", ">nan<", 15, "nan"),
        (">0.5<", ">1.5<", 17, "1.5"),
        ("<speed>20<", "<speed>0<", 17, "0"),
        ("<destination_servo_id>1<", "<destination_servo_id>7<", 14, "7"),
        ('robot_part="Neck"', 'robot_part="Nick"', 20, "Neck"),
        ('<generic_servo id="2"', '<generic_servo id="1"', 22, "id 1"),
        ("_number>3<", "_number>4<", 12, "4"),
        ('pos="1.0"', 'pos="9.0"', 27, "9"),
        ('pos="1.0"', 'pos="-1.5"', 27, "roll"),
        ('servo="1" coefficient', 'servo="9" coefficient', 9, "9"),
        ("<stiffness>", "<stifness>", 17, "stif"),
        ('name="head"', 'name="head" colour="red"', 11, "colour"),
        ('version="1"', 'version="7"', 2, "7"),
        ('rate="100"', 'rate="0"', 31, "0"),
        ('of="Neck"', 'of="Nek"', 32, "did you mean 'Neck'"),
        ('<address of="Neck"', '<address of="Neck" to="/a"/><address of="Neck"', 32, "second address of"),
        ("<transform_factor>", "<transform_type>cubic</transform_type><transform_factor>", 15, "linear"),
    ],
)  # fmt: skip
def test_each_fault_names_line_and_what_is_valid(
    tmp_path: Path, old: str, new: str, line: int, words: str
) -> None:
    text = changed(old, new).replace("<stifness>0.5</stiffness>", "<stifness>0.5</stifness>")
    found = faults(tmp_path, text)
    here = [fault for fault in found if fault.startswith(f"line {line}:")]
    assert here, found
    assert any(words in fault for fault in here), found


def test_all_faults_come_at_once(tmp_path: Path) -> None:
    text = GOOD
    for old, new in [
        ('min="-90"', 'min="nan"'),
        (">-2<", ">0<"),
        ("_number>3<", "_number>9<"),
        ("200", "-2"),
    ]:
        text = text.replace(old, new, 1)
    assert len(faults(tmp_path, text)) >= 4


def test_dtds_are_refused(tmp_path: Path) -> None:
    laughs = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]>'
    for dtd in (laughs, '<!DOCTYPE x SYSTEM "file:///etc/passwd">', "<!DOCTYPE generic_robot>"):
        found = faults(tmp_path, GOOD.replace('<?xml version="1.0"?>', f'<?xml version="1.0"?>{dtd}'))
        assert any("DTD" in fault or "DOCTYPE" in fault for fault in found), found


def test_huge_and_deep_files_are_refused(tmp_path: Path) -> None:
    huge = GOOD + "<!--" + "x" * (1 << 20) + "-->"
    assert any("1048576 bytes" in fault for fault in faults(tmp_path, huge))
    deep = "<a>" * 80 + "</a>" * 80
    assert any("64 deep" in fault for fault in faults(tmp_path, GOOD.replace("<binding", f"{deep}<binding")))


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path, words in ((tmp_path, "regular file"), (tmp_path / "none.xml", "opened")):
        with pytest.raises(DescriptionError, match=words):
            read_robot(path)


def test_a_model_file_stays_beside_its_description(tmp_path: Path) -> None:
    model = '<model format="mjcf" file="../../secret.xml" torso_link="Torso"/>'
    found = faults(tmp_path, changed('<robot_part name="LArm">', model + '<robot_part name="LArm">'))
    assert any("secret" in fault for fault in found), found


MODELS = {
    "mjcf": "<mujoco><worldbody><body name='chest'><joint name='free' type='free'/><site name='spot'/>"
    "<body name='arm'><joint name='ball' type='ball'/><joint name='one'/></body></body></worldbody></mujoco>",
    "urdf": "<robot name='r'><link name='world'/><link name='chest'/><link name='arm'/>"
    + "".join(
        f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/></joint>"
        for name, kind, parent, child in (
            ("free", "floating", "world", "chest"), ("one", "revolute", "chest", "arm"),
        )
    )
    + "</robot>",
}  # fmt: skip


@pytest.mark.parametrize("format", ["mjcf", "urdf"])
def test_what_a_servo_or_a_link_of_the_model_can_be(tmp_path: Path, format: str) -> None:
    """Without these messages, the kinematics would find these faults later. Each message names the line."""
    (tmp_path / "model").write_text(MODELS[format])
    model = f'<model format="{format}" file="model" torso_link="chest"/>'
    text = changed('<robot_part name="LArm">', model + '<robot_part name="LArm">')
    text = text.replace('name="pitch">', 'name="pitch" joint="one">')
    assert read_robot(write(tmp_path, text)).model is not None
    joint = "ball" if format == "mjcf" else "free"
    found = faults(
        tmp_path, text.replace('joint="one"', f'joint="{joint}"').replace('link="chest"', 'link="world"')
    )
    assert found == [
        "line 3: the model has no link 'world'; valid: arm, chest",
        f"line 4: the model has no moving joint '{joint}'; valid: one",
    ]
    module = '<patch name="p" part="head" link="arm" rate="9" channels="12">' \
        '<sensor rest="0" pascal_per_count="1" min="0" max="9"/>' \
        '<triangular_modules><module frame="spot" port="0"/></triangular_modules></patch>'  # fmt: skip
    skin = text.replace('<binding middleware="sim"', f'<skin>{module}</skin><binding middleware="sim"')
    assert "the model has no link 'spot'; valid: arm, chest" in faults(tmp_path, skin)[0]


def test_a_model_of_a_package_that_is_not_installed_says_what_to_install(tmp_path: Path) -> None:
    model = '<model format="urdf" package="no-such-package" extra="icub" file="m.urdf" torso_link="chest"/>'
    path = write(tmp_path, changed('<robot_part name="LArm">', model + '<robot_part name="LArm">'))
    with pytest.raises(MissingExtraError, match=re.escape(advice("icub"))):
        read_robot(path)


def test_damaged_files_never_raise_anything_else(tmp_path: Path) -> None:
    """Tests random damage. `make fuzz` runs more cases."""
    chance = random.Random(3)
    for _ in range(int(os.environ.get("TCI_FUZZ", "400"))):
        path = write(tmp_path, damage(GOOD.encode(), chance))
        try:
            read_robot(path)
        except TciError as error:
            named = str(path) in str(error)
        else:
            named = True
        assert named


@settings(max_examples=50, deadline=None)
@given(
    gamma=st.floats(1e-3, 1e3).flatmap(lambda size: st.sampled_from([size, -size])),
    sigma=st.floats(-180, 180),
)
def test_numbers_survive_the_file(
    tmp_path_factory: pytest.TempPathFactory, gamma: float, sigma: float
) -> None:
    text = LISTING_2.replace("<transform_factor>1.00<", f"<transform_factor>{gamma!r}<")
    text = text.replace("<transform_displacement>0.00<", f"<transform_displacement>{sigma!r}<")
    servo = read_robot(write(tmp_path_factory.mktemp("numbers"), text)).parts[0].servos[0]
    assert servo.scale == gamma
    np.testing.assert_allclose(servo.offset, np.deg2rad(sigma))


SURFACE = """<skin><patch name="p" part="head" link="l" rate="100" channels="4">{}<truncated_cone length="0.1"
    r1="0.02" r2="0.02" rings="2" per_ring="2"/></patch></skin></generic_robot>"""
MODEL = '<model format="mjcf" file="m.xml" torso_link="l"/>'


def with_patch(folder: Path, inside: str) -> Path:
    """Writes a description with one patch."""
    (folder / "m.xml").write_text("<mujoco><worldbody><body name='l'/></worldbody></mujoco>")
    path = folder / "robot.xml"
    text = GOOD.replace('<robot_part name="LArm">', MODEL + '<robot_part name="LArm">', 1)
    path.write_text(text.replace("</generic_robot>", SURFACE.format(inside)))
    return path


def test_a_patch_has_a_sensor_or_is_felt_through_joints(tmp_path: Path) -> None:
    robot = read_robot(with_patch(tmp_path, "<felt_through_joints/>"))
    assert robot.patches[0].through_joints
    assert not robot.skin
    sensor = '<sensor rest="0" pascal_per_count="1" min="0" max="255"/>'
    assert read_robot(with_patch(tmp_path, sensor)).skin
    for wrong in ("", sensor + "<felt_through_joints/>"):
        with pytest.raises(DescriptionError, match="valid: one of sensor, felt_through_joints"):
            read_robot(with_patch(tmp_path, wrong))


def test_the_schema_agrees(tmp_path: Path) -> None:
    schema = etree.XMLSchema(etree.parse(str(schema_path())))
    for text in (GOOD, LISTING_2):
        schema.assertValid(etree.fromstring(text.encode()))
    for old, new in [
        (' angle_unit="deg"', ""),
        ("<stiffness>0.5</stiffness>", "<stifness>0.5</stifness>"),
        ('min="-90"', 'min="nan"'),
        ('name="head"', 'name="head" colour="red"'),
        ('<generic_servo id="0"', "<generic_servo"),
    ]:
        assert not schema.validate(etree.fromstring(changed(old, new).encode())), new


def test_schema_and_reference_are_made_of_the_grammar() -> None:
    table = ROOT / "docs" / "tables" / "robot-description.md"
    anew = f"make them anew: python -m tci.robot.xml.schema {schema_path()} {table}"
    assert schema_path().read_text(encoding="utf-8") == schema_text(), anew
    assert table.read_text(encoding="utf-8") == table_text(), anew


def test_each_element_of_the_grammar_fills_fields_that_there_are() -> None:
    def look(element: Element) -> None:
        assert element.describes is not None or not element.fields
        fields = element.describes.model_fields if element.describes is not None else {}
        names = element.values.keys() | {tag for tag, child in element.children.items() if child.text}
        assert set(element.fields.values()) - {None} <= set(fields)
        assert set(element.fields) <= names
        for child in element.children.values():
            look(child)

    look(GENERIC_ROBOT)
