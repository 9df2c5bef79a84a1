"""Readers of skin calibration files: the irregularities of each source of files, and damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.skin_data import FOLDERS, SkinData, cone_file
from tci.errors import DescriptionError
from tci.robot.skin_files.file import read_skin_file
from tci.robot.skin_files.normals import estimate_normals
from tci.skin.nearest import nearest_on_faces
from tci.skin.triangulation import triangulate

HEAD = "name\tdemo\nspatial_sampling taxel\n"
ROW = "0.01 0.02 0.03 0 0 1\n"

# Number of channels with a position, number of taxels among these, and number of all channels.
COUNTS = {
    "icub/positions/left_forearm_V2.txt": (240, 240, 384),
    "icub/positions/left_forearm_mesh.txt": (276, 230, 384),
    "icub/positions/left_forearm_nomesh.txt": (275, 229, 384),
    "icub/positions/left_arm.txt": (350, 350, 768),
    "icub/positions/left_arm_mesh.txt": (435, 361, 768),
    "icub/positions/left_hand_V2_1.txt": (48, 44, 192),
    "icub/positions/torso.txt": (528, 440, 768),
    "icub/positions/left_leg_upper.txt": (680, 680, 1344),
    "icub/positions/left_leg_lower.txt": (380, 380, 768),
    "icub/positions/left_foot.txt": (250, 250, 384),
    "icub/positions_pycub/left_forearm.txt": (240, 240, 768),
    "icub/positions_pycub/left_arm.txt": (350, 350, 768),
    "icub/positions_pycub/left_hand.txt": (48, 44, 192),
    "icub/positions_pycub/torso.txt": (430, 430, 768),
    "icub/positions_pycub/left_leg_upper.txt": (680, 680, 1344),
    "icub/positions_pycub/left_leg_lower.txt": (380, 380, 768),
    "icub/positions_pycub/left_foot.txt": (250, 250, 384),
    "nao/positions/nao_left_hand.txt": (240, 240, 384),
    "nao/positions/nao_head.txt": (240, 240, 384),
    "nao/positions/nao_torso.txt": (250, 250, 384),
}
BOTH = {name.replace("left", side): count for name, count in COUNTS.items() for side in ("left", "right")}


@pytest.mark.parametrize("name", BOTH)
def test_each_file_has_its_taxels(name: str, skin_data: SkinData) -> None:
    skin = read_skin_file(skin_data.file(name))
    assert (int(skin.valid.sum()), len(skin.taxels), skin.channels) == BOTH[name]
    lengths = np.linalg.norm(skin.normals, axis=1)
    np.testing.assert_allclose(lengths, np.where(skin.valid, 1.0, 0.0), atol=1e-9)
    assert not skin.positions.flags.writeable


def test_every_file_is_in_the_table(skin_data: SkinData) -> None:
    root = skin_data.folder
    found = {str(file.relative_to(root)) for folder in FOLDERS for file in (root / folder).glob("*.txt")}
    assert found == set(BOTH)


def test_placeholder_and_missing_normals_are_estimated_and_marked(skin_data: SkinData) -> None:
    for name, marked in {"left_arm": 350, "left_forearm_nomesh": 275, "left_forearm_V2": 0}.items():
        assert read_skin_file(skin_data.file(f"icub/positions/{name}.txt")).estimated.sum() == marked


@pytest.mark.parametrize("name", BOTH)
def test_listed_normals_that_do_not_fit_the_positions_are_estimated_and_told(
    name: str, skin_data: SkinData
) -> None:
    skin = read_skin_file(skin_data.file(name))
    wrong = "nao_head" in name or "nao/positions/nao_left_hand" in name or "nao_right_hand" in name
    wrong |= "positions_pycub" in name and "_hand" in name
    assert ("degrees off the planes through their neighbours" in skin.note) == wrong
    assert not wrong or skin.estimated[skin.taxels].all()
    around = estimate_normals(skin.positions[skin.taxels])
    angle = np.abs(np.einsum("ni,ni->n", around, skin.normals[skin.taxels]))
    assert np.degrees(np.arccos(np.clip(np.median(angle), 0.0, 1.0))) < 20.0


@pytest.mark.parametrize("name", BOTH)
def test_the_projection_of_each_taxel_is_the_taxel(name: str, skin_data: SkinData) -> None:
    skin = read_skin_file(skin_data.file(name))
    places = skin.positions[skin.taxels]
    faces = triangulate(places, skin.normals[skin.taxels])
    there = nearest_on_faces(places, faces, places)[2]
    assert np.linalg.norm(there - places, axis=1).max() <= 1e-3


def test_estimated_normals_agree_with_measured_ones(skin_data: SkinData) -> None:
    skin = read_skin_file(skin_data.file("icub/positions/left_forearm_mesh.txt"))
    guess = estimate_normals(skin.positions[skin.valid])
    cosines = np.einsum("ni,ni->n", guess, skin.normals[skin.valid])
    assert np.degrees(np.arccos(np.median(cosines))) < 5.0


def test_a_written_file(tmp_path: Path) -> None:
    skin = read_skin_file(cone_file(tmp_path / "skin.txt"))
    assert (skin.name, skin.sampling, skin.channels, len(skin.taxels)) == ("cone", "taxel", 192, 160)
    assert skin.valid[-1]
    assert skin.pads.sum() == 32
    assert skin.estimated.sum() == 160
    outward = skin.positions[skin.taxels, :2] / np.linalg.norm(
        skin.positions[skin.taxels, :2], axis=1, keepdims=True
    )
    assert np.einsum("ni,ni->n", outward, skin.normals[skin.taxels, :2]).min() > 0.8


def test_pads_by_list_and_representatives(tmp_path: Path) -> None:
    reprs = "3 3 3 3 3 3 -2 3 3 3 -1 3 -1"
    file = tmp_path / "skin.txt"
    file.write_text(HEAD + f"taxel2Repr ( {reprs} )\n[calibration]\n" + 12 * ROW + "\n" + "0 0 0 0 0 0\n")
    skin = read_skin_file(file)
    assert np.flatnonzero(skin.pads).tolist() == [6, 10]
    assert skin.representative[0] == 3
    assert not skin.valid[12]
    assert not skin.estimated.any()


DAMAGE = {
    "cut in a row": (HEAD + 11 * ROW + "0.01 0.02", 14, "row of 2 numbers"),
    "rows missing": (HEAD + 11 * ROW, 13, "11 rows"),
    "list longer than the rows": (HEAD + f"taxel2Repr ({13 * '3 '})\n" + 12 * ROW, 15, "row 12"),
    "list cut off": (HEAD + "taxel2Repr ( 3 3\n" + 12 * ROW, 3, "cut off"),
    "bad representative": (HEAD + f"taxel2Repr ( x {11 * '3 '})\n" + 12 * ROW, 3, "'x'"),
    "underscore": (HEAD + 11 * ROW + "0.01 0.0_1 0 0 0 1\n", 14, "y is '0.0_1'"),
    "nan": (HEAD + 11 * ROW + "0.01 nan 0 0 0 1\n", 14, "y is 'nan'"),
    "infinite": (HEAD + "inf 0 0 0 0 1\n" + 11 * ROW, 3, "x is 'inf'"),
    "millimetres": (HEAD + "10 20 30 0 0 1\n" + 11 * ROW, 3, "x is '10'"),
    "no number": (HEAD + "0.1 0.x 0 0 0 1\n" + 11 * ROW, 3, "0.x"),
    "binary": (HEAD + ROW + "\0\1\2" + 11 * ROW, 4, "no text"),
    "too many rows": (HEAD + 17000 * ROW, 16387, "16384 rows"),
    "too large": (HEAD + 120000 * ROW, 1, "bytes"),
    "empty": ("", 1, "0 rows"),
    "all absent": (HEAD + 12 * "0 0 0 0 0 0\n", 14, "none with a position"),
    "sampling": ("spatial_sampling both\n" + 12 * ROW, 1, "both"),
    "unknown word": (HEAD + "colour red\n" + 12 * ROW, 3, "colour"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_gets_one_error_with_its_line(name: str, tmp_path: Path) -> None:
    text, line, words = DAMAGE[name]
    file = tmp_path / "skin.txt"
    file.write_bytes(text.encode())
    with pytest.raises(DescriptionError, match=words) as caught:
        read_skin_file(file)
    assert [fault.line for fault in caught.value.faults] == [line]


def test_a_missing_file_is_one_error(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match=r"none\.txt.*\n.*can.t be opened"):
        read_skin_file(tmp_path / "none.txt")


@given(data=st.binary(max_size=300), cut=st.integers(0, 5000))
def test_nothing_but_its_own_error(data: bytes, cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "damaged.txt"
    whole = (HEAD + 24 * ROW).encode()
    file.write_bytes(whole[: cut % len(whole)] + data)
    try:
        skin = read_skin_file(file)
    except DescriptionError:
        return
    assert skin.valid.any()


def test_truncated_files_never_load_with_fewer_taxels(tmp_path: Path, skin_data: SkinData) -> None:
    for name in ("icub/positions/left_forearm_V2.txt", "icub/positions/left_hand_V2_1.txt"):
        whole = skin_data.file(name).read_bytes()
        expected = len(read_skin_file(skin_data.file(name)).taxels)
        file = tmp_path / "cut.txt"
        for end in range(0, len(whole), 97):
            file.write_bytes(whole[:end])
            try:
                found = len(read_skin_file(file).taxels)
            except DescriptionError as error:
                found = expected if all(fault.line for fault in error.faults) else -1
            assert found == expected


def test_flat_and_thin_skins_have_normals_or_none() -> None:
    x, y = np.meshgrid(np.arange(5) * 0.01, np.arange(5) * 0.01)
    flat = np.column_stack([x.ravel(), y.ravel(), np.full(25, -0.02)])
    np.testing.assert_allclose(estimate_normals(flat), np.tile([0.0, 0.0, -1.0], (25, 1)), atol=1e-9)
    assert not estimate_normals(flat[:5]).any()
