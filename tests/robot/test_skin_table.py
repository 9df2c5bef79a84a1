"""A patch that a skin calibration file defines has the same features as any other patch."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import tci.robot
from helpers.skin_data import SkinData, cone_file
from tci.errors import DescriptionError
from tci.exports.cone import cone_of
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.file import read_skin_file
from tci.robot.xml import read_robot
from tci.robot.xml.document import read_bytes
from tci.skin.skin import Skin
from tci.skin.surfaces import Surface, build_surface

NAO = Path(tci.robot.__file__).parent / "robots" / "nao"


def nao_with(folder: Path, file: Path, *, channels: int, form: str = "icub") -> Robot:
    """Returns the NAO, read from XML, whose left forearm uses the file as its skin."""
    shutil.copytree(NAO, folder / "nao")
    shutil.copy(file, folder / "nao" / "skin.txt")
    robot = folder / "nao" / "robot.xml"
    root = etree.fromstring(read_bytes(robot))
    (patch,) = root.iterfind(".//patch[@name='left_forearm']")
    patch.set("channels", str(channels))
    patch.replace(patch.find("truncated_cone"), etree.fromstring(f'<table file="skin.txt" format="{form}"/>'))
    robot.write_bytes(etree.tostring(root))
    return read_robot(robot)


def surface_of(robot: Robot) -> Surface:
    return build_surface(robot, robot.patch("left_forearm"), KinematicChain(robot))


def test_an_owners_file_in_place_of_the_cone(tmp_path: Path) -> None:
    robot = nao_with(tmp_path, cone_file(tmp_path / "cone.txt"), channels=192)
    surface = surface_of(robot)
    assert len(surface.positions) == 160
    assert not set(surface.channels % 12) & {6, 10}
    assert (surface.areas > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1.0)
    assert "left_forearm" in Skin(robot).surfaces


@pytest.mark.parametrize(
    ("name", "channels", "taxels"),
    [
        ("icub/positions_pycub/left_forearm.txt", 768, 240),
        ("icub/positions/left_forearm_V2.txt", 384, 240),
        ("icub/positions/left_forearm_mesh.txt", 384, 230),
        ("nao/positions/nao_left_hand.txt", 384, 240),
    ],
)
def test_each_origins_files_become_surfaces(
    name: str, channels: int, taxels: int, tmp_path: Path, skin_data: SkinData
) -> None:
    robot = nao_with(tmp_path, skin_data.file(name), channels=channels)
    with warnings.catch_warnings(record=True) as told:
        surface = surface_of(robot)
    wrong = ["normals are 70 degrees off" in str(one.message) for one in told]
    assert wrong == [True] * ("nao_left_hand" in name)
    assert len(surface.positions) == taxels
    assert 50e-4 < surface.areas.sum() < 300e-4
    assert cone_of(robot, surface, KinematicChain(robot)).length > 0.05


SOLE = {
    "left": {0: (43.83, -8.11), 3: (50.14, -6.42), 123: (93.21, 32.37)},
    "right": {0: (70.84, 37.59), 3: (72.53, 31.28), 123: (115.60, -7.50)},
}
"""Positions [mm] of some channels of icub-main's left_foot.txt and right_foot.txt, in the frame of the
foot."""


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_modules_of_an_icubs_sole_are_numbered_as_its_files_say(side: str, skin_data: SkinData) -> None:
    """In recordings of real right feet, neighbouring taxels have similar values at these positions
    (correlation 0.91 across modules). With the positions by the numbers of the model's frames, without
    rotations, the correlation is 0.80."""
    robot = load_robot("icub-whole")
    patch = robot.patch(f"{side}_sole")
    surface = build_surface(robot, patch, KinematicChain(robot))
    for channel, place in SOLE[side].items():
        (found,) = surface.positions[surface.channels == channel]
        np.testing.assert_allclose(1e3 * found[:2], place, atol=0.01)
    assert patch.channels == 384, "as real feet send"
    if skin_data.genuine:
        layout = read_skin_file(skin_data.file(f"icub/positions/{side}_foot.txt"))
        assert {*surface.channels.tolist()} == {*layout.taxels.tolist()}
        np.testing.assert_allclose(surface.positions, layout.positions[surface.channels], atol=1e-5)


def test_faults_of_the_file_and_of_the_format(tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.txt"
    damaged.write_text("name x\n" + 11 * "0 0 0.01 0 0 1\n" + "0 nan 0 0 0 1\n")
    robot = nao_with(tmp_path / "a", damaged, channels=12)
    with pytest.raises(DescriptionError, match="line 13"):
        surface_of(robot)
    with pytest.raises(DescriptionError, match="icub"):
        nao_with(tmp_path / "b", damaged, channels=12, form="nonsense")
    few = nao_with(tmp_path / "c", cone_file(tmp_path / "cone.txt"), channels=100)
    with pytest.raises(DescriptionError, match="channels"):
        surface_of(few)
