"""Tables, plain rows and URDF sensors give equal skins. A damaged file gives one error that names the
line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.skin_data import SkinData, cone_file
from tci.errors import DescriptionError, UnknownNameError
from tci.messages.frames import rotation_rpy
from tci.robot.skin_files.csv import read_skin_csv
from tci.robot.skin_files.layout import SkinLayout
from tci.robot.skin_files.reader import read_layout
from tci.robot.skin_files.urdf import read_tactile_sensors

HEAD = "channel, x [mm], y [mm], z [mm], nx, ny, nz, module, kind, area [mm2]\n"
ROWS = (
    "0, 10, 0, 0, 0, 0, 1, 0, taxel, 30\n"
    "1, 15, 0, 0, 0, 0, 1, 0, taxel, 30\n"
    "3, 10, 5, 0, 0, 0, 1, 1, , \n"
    "4, , , , , , , 1, pad, \n"
)


def written(folder: Path, text: str | bytes, name: str = "skin.csv") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_a_table_with_all_columns(tmp_path: Path) -> None:
    skin = read_layout(written(tmp_path, HEAD + "# sole\n" + ROWS))
    np.testing.assert_allclose(skin.positions[[0, 1, 3]], [[0.01, 0, 0], [0.015, 0, 0], [0.01, 0.005, 0]])
    np.testing.assert_array_equal(skin.normals[[0, 1, 3]], np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert (skin.channels, skin.taxels.tolist()) == (5, [0, 1, 3])
    assert skin.valid.tolist() == [True, True, False, True, False]
    assert skin.pads.tolist() == [False] * 4 + [True]
    assert skin.modules.tolist() == [0, 0, -1, 1, 1]
    assert skin.representative.tolist() == [0, 1, -1, 3, -2]
    hexagon = np.sqrt(0.75) * 0.005**2
    np.testing.assert_allclose(skin.areas, [30e-6, 30e-6, 0.0, hexagon, 0.0])


def test_only_positions_in_another_unit_and_separator(tmp_path: Path) -> None:
    cone = read_layout(cone_file(tmp_path / "cone.txt"))
    rows = "".join(f"{x * 100};{y * 100};{z * 100}\n" for x, y, z in cone.positions[cone.taxels])
    skin = read_layout(written(tmp_path, "x [cm];y [cm];z (cm)\n" + rows))
    np.testing.assert_allclose(skin.positions, cone.positions[cone.taxels], atol=1e-12)
    assert skin.estimated.all()
    np.testing.assert_allclose(np.linalg.norm(skin.normals, axis=1), 1.0)


DAMAGE = {
    "empty": ("", 1, "empty"),
    "comments only": ("# x [m], y [m], z [m]\n", 1, "empty"),
    "no unit": ("x, y [m], z [m]\n0,0,0\n", 1, "no unit"),
    "unknown unit": ("x [ft], y [m], z [m]\n0,0,0\n", 1, "ft"),
    "unknown column": ("x [m], y [m], z [m], colour\n0,0,0,red\n", 1, "colour"),
    "second column": ("x [m], y [m], z [m], x [m]\n0,0,0,0\n", 1, "second"),
    "lacks z": ("x [m], y [m]\n0,0\n", 1, "lacks z"),
    "half a normal": ("x [m], y [m], z [m], nx\n0,0,0,1\n", 1, "only nx"),
    "rows missing": (HEAD, 1, "no taxels"),
    "cut in a row": (HEAD + ROWS + "5, 10", 6, "2 cells"),
    "underscore": (HEAD + ROWS.replace("15, 0, 0", "1_5, 0, 0"), 3, "x is '1_5'"),
    "nan": (HEAD + ROWS.replace("15, 0, 0", "nan, 0, 0"), 3, "x is 'nan'"),
    "huge": (HEAD + ROWS.replace("15, 0, 0", "15e9, 0, 0"), 3, "x is '15e9'"),
    "metres as millimetres": (HEAD.replace("mm]", "m]") + ROWS, 2, "x is '10'"),
    "no number": (HEAD + ROWS.replace("15, 0", "1.5.1, 0"), 3, "1.5.1"),
    "channel twice": (HEAD + ROWS.replace("1, 15", "0, 15"), 3, "line 2 already"),
    "channel huge": (HEAD + ROWS.replace("4, ,", "99999, ,"), 5, "99999"),
    "channel empty": (HEAD + ROWS.replace("4, ,", " , ,"), 5, "no channel"),
    "kind": (HEAD + ROWS.replace("pad", "pod"), 5, "pod"),
    "area below 0": (HEAD + ROWS.replace("taxel, 30\n1", "taxel, -30\n1"), 2, "area is '-30'"),
    "all pads": (HEAD + "0, 1, 1, 1, 0, 0, 1, 0, pad, \n", 2, "no taxels"),
    "binary": (HEAD.encode() + b"\x00\x01\x02" + ROWS.encode(), 2, "no text"),
    "too many rows": ("x [m],y [m],z [m]\n" + 17000 * "0,0,0\n", 16386, "16384 rows"),
    "too large": (HEAD + 120000 * ROWS, 1, "bytes"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_a_damaged_table_is_one_error_with_its_line(name: str, tmp_path: Path) -> None:
    text, line, words = DAMAGE[name]
    with pytest.raises(DescriptionError, match=words) as caught:
        read_skin_csv(written(tmp_path, text))
    assert line in [fault.line for fault in caught.value.faults]


@given(data=st.binary(max_size=200), cut=st.integers(0, 300))
def test_a_table_raises_nothing_but_its_own_error(
    data: bytes, cut: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    whole = (HEAD + ROWS).encode()
    try:
        skin = read_skin_csv(written(tmp_path_factory.getbasetemp(), whole[: cut % len(whole)] + data))
    except DescriptionError:
        return
    assert len(skin.taxels)


def test_plain_rows(tmp_path: Path) -> None:
    rows = "0.1 0 0 0 0 0.5\n0 0 0 0 0 0\n0.1,0.01,0,0,0,1 # last\n"
    skin = read_layout(written(tmp_path, rows, "skin.dat"), form="rows")
    assert skin.taxels.tolist() == [0, 2]
    np.testing.assert_array_equal(skin.normals[0], [0.0, 0.0, 1.0])
    for text, words in (("1 2\n", "row of 2"), ("0 0 0 0 0 0\n", "no taxels"), ("a b c\n", "'a'")):
        with pytest.raises(DescriptionError, match=words) as caught:
            read_layout(written(tmp_path, text, "bad.dat"), form="rows")
        assert caught.value.faults[0].line == 1


ARRAY = """<robot name="r"><link name="l_hand"/>
  <sensor name="palm" update_rate="100"><parent link="l_hand"/><origin xyz="0 0 0.01" rpy="0 1.5707963 0"/>
    <tactile channel="hand"><array rows="2" cols="3" size="0.003 0.002" spacing="0.004 0.005"
    offset="0 0.001"/>
    </tactile></sensor>
  <sensor name="tip"><parent link="l_hand"/><tactile>
    <taxel idx="1" xyz="0.1 0 0" rpy="3.14159265 0 0"/>
    <taxel idx="3" xyz="0.1 0.004 0"/></tactile></sensor>
  <sensor name="eye"><parent link="l_hand"/><camera/></sensor>
</robot>"""


def test_tactile_sensors_of_a_urdf(tmp_path: Path) -> None:
    path = written(tmp_path, ARRAY, "robot.urdf")
    palm, tip = read_tactile_sensors(path)
    assert (palm.name, palm.link, palm.data, palm.rate) == ("palm", "l_hand", "hand", 100.0)
    # Row-major order: index 4 is row 1, column 1.
    local = np.array([0.004, 0.005 - 0.001, 0.0])
    R = rotation_rpy(0.0, 1.5707963, 0.0)
    np.testing.assert_allclose(palm.layout.positions[4], R @ local + [0, 0, 0.01], atol=1e-12)
    np.testing.assert_allclose(palm.layout.normals, np.tile(R[:, 2], (6, 1)), atol=1e-12)
    np.testing.assert_allclose(palm.layout.areas, 6e-6)
    assert tip.layout.taxels.tolist() == [1, 3]
    np.testing.assert_allclose(tip.layout.normals[[1, 3], 2], [-1.0, 1.0], atol=1e-7)
    assert read_layout(path, sensor="tip").name == "tip"
    with pytest.raises(DescriptionError, match="palm, tip"):
        read_layout(path)
    with pytest.raises(DescriptionError, match="'palm'"):
        read_layout(path, sensor="plam")


URDF_DAMAGE = {
    "cut off": (ARRAY[:300], 6, "not well-formed"),
    "no sensors": ('<robot name="r"><link name="l_hand"/></robot>', 1, "no tactile sensor"),
    "unknown link": (
        ARRAY.replace('parent link="l_hand"/><origin', 'parent link="l_hnd"/><origin'),
        2,
        "l_hand",
    ),
    "no such order": (ARRAY.replace('rows="2"', 'rows="2" order="spiral"'), 4, "spiral"),
    "rows": (ARRAY.replace('rows="2"', 'rows="-2"'), 4, "rows"),
    "too many": (ARRAY.replace('rows="2" cols="3"', 'rows="1000" cols="1000"'), 4, "16384"),
    "size": (ARRAY.replace('size="0.003 0.002"', 'size="0.003 0"'), 4, "size"),
    "nan": (ARRAY.replace('xyz="0.1 0 0"', 'xyz="nan 0 0"'), 7, "xyz"),
    "huge": (ARRAY.replace('xyz="0.1 0 0"', 'xyz="1e300 0 0"'), 7, "xyz"),
    "twice": (ARRAY.replace('idx="3"', 'idx="1"'), 8, "line 7"),
    "no array": (ARRAY.replace("<array", "<arrays"), 2, "0 <array>"),
    "binary": (b"\x00\x01" + ARRAY.encode(), 1, "XML|text"),
    "entity": ('<!DOCTYPE r [<!ENTITY a "b">]>' + ARRAY, 1, "DOCTYPE|DTD"),
}


@pytest.mark.parametrize("name", URDF_DAMAGE)
def test_a_damaged_urdf_is_one_error_with_its_line(name: str, tmp_path: Path) -> None:
    text, line, words = URDF_DAMAGE[name]
    with pytest.raises(DescriptionError, match=words) as caught:
        read_tactile_sensors(written(tmp_path, text, "robot.urdf"))
    assert line in [fault.line for fault in caught.value.faults]


def test_every_format_goes_the_same_way(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="rows, icub, csv, urdf"):
        read_layout(tmp_path / "x.txt", form="stl")
    layout = read_layout(cone_file(tmp_path / "cone.txt"))
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = rotation_rpy(0.1, 0.2, 0.3), (0.01, 0.02, 0.03)
    moved = layout.moved(turn)
    taxels = layout.taxels
    np.testing.assert_allclose(
        moved.positions[taxels], layout.positions[taxels] @ turn[:3, :3].T + turn[:3, 3], atol=1e-12
    )
    assert not moved.positions[~layout.valid].any()


def modules_of(skin: SkinLayout) -> int:
    return len(np.unique(skin.modules[skin.taxels]))


def test_modules_of_files(skin_data: SkinData) -> None:
    assert modules_of(read_layout(skin_data.file("icub/positions/left_forearm_V2.txt"))) == 24
    assert modules_of(read_layout(skin_data.file("icub/positions/left_foot.txt"))) == 25
