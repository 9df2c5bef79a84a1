"""`tci skin check` detects skin positions in a wrong frame, and prints the correction."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from helpers.skin_data import SkinData
from tci.cli import skin_check
from tci.cli.main import app
from tci.lab.authoring.check_skin import check_skins, spans
from tci.lab.authoring.registration import link_surface, register
from tci.messages.frames import apply, rotation_rpy, transform
from tci.robot.catalogue import load_robot
from tci.robot.skin_files.file import read_skin_file

ICUB = load_robot("icub")


def check(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, ["skin", "check", *arguments])
    return result.exit_code, result.output


def test_the_right_arms_file_is_off_and_its_correction_is_found(genuine_data: SkinData) -> None:
    file = genuine_data.file("icub/positions/right_arm.txt")
    status, text = check("icub", "--file", str(file), "--link", "r_upper_arm", "--json")
    assert status == 1
    (row,) = json.loads(text)["skins"]
    assert row["verdict"] == "wrong"
    assert row["mean_mm"] == pytest.approx(31.6, abs=0.3)
    assert row["correction"]["mends"]
    assert row["correction"]["mean_mm"] < 1.0
    print(row["correction"])
    known = np.array(
        [[-0.79629, -0.00546, 0.60489], [0.60489, -0.01745, 0.79612], [0.00621, 0.99983, 0.0172]]
    )
    turned = np.array(row["correction"]["R"]) @ known.T
    assert np.rad2deg(np.arccos((np.trace(turned) - 1.0) / 2.0)) < 3.0
    np.testing.assert_allclose(row["correction"]["xyz_m"], [0.0106, 0.0290, -0.0099], atol=0.003)
    status, text = check("icub", "--file", str(file), "--link", "r_upper_arm")
    assert "is in a wrong frame" in text
    assert "xyz=" in text


@pytest.mark.parametrize(("name", "link"), [("left_arm", "l_upper_arm"), ("left_leg_lower", "l_lower_leg")])
def test_files_in_their_links_frame_fit(name: str, link: str, genuine_data: SkinData) -> None:
    skin = read_skin_file(genuine_data.file(f"icub/positions/{name}.txt"))
    found = register(skin.positions[skin.valid], link_surface(ICUB, link))
    assert found.fits
    assert not found.mends
    assert found.mean < 0.002


def test_a_file_in_another_frame_is_wrong_and_its_correction_is_printed(tmp_path: Path) -> None:
    """The file contains points in the frame of the link, with an offset. A check of 14 such patches takes up
    to a minute."""
    surface = link_surface(ICUB, "l_upper_arm")
    points = surface.points[:: len(surface.points) // 192][:192]
    moved = transform(rotation_rpy(0.4, -0.9, 2.0), np.array([0.05, -0.02, 0.08]))
    file = tmp_path / "left_arm.txt"
    file.write_text("".join("{:.6f} {:.6f} {:.6f}\n".format(*row) for row in apply(moved, points)))
    begin = time.process_time()
    status, text = check("icub", "--file", str(file), "--link", "l_upper_arm", "--json")
    assert time.process_time() - begin < 60.0 / 14
    (row,) = json.loads(text)["skins"]
    assert (status, row["verdict"], row["correction"]["mends"]) == (1, "wrong", True)
    assert row["mean_mm"] > 5.0
    assert row["correction"]["mean_mm"] < 1.0
    found = transform(np.array(row["correction"]["R"]), np.array(row["correction"]["xyz_m"]))
    np.testing.assert_allclose(apply(found @ moved, points), points, atol=0.002)
    status, text = check("icub", "--file", str(file), "--link", "l_upper_arm")
    assert status == 1
    assert "is in a wrong frame" in text
    assert "xyz=" in text


def test_progress_is_told_and_a_skin_that_fits_has_no_correction() -> None:
    told: list[tuple[str, int, int]] = []
    rows = check_skins(ICUB, progress=lambda *step: told.append(step))
    assert told == [(patch.name, done, 4) for done, patch in enumerate(ICUB.skin)]
    assert {row["verdict"] for row in rows} == {"fits"}
    for row in rows:
        np.testing.assert_array_equal(row["correction"]["R"], np.eye(3))
        assert row["correction"]["mean_mm"] == row["mean_mm"]


def test_a_patch_gets_the_smaller_of_two_corrections_as_an_element_that_moves_it(tmp_path: Path) -> None:
    """Two corrections fit a flat sole to its link, of which one turns the sole upside down. The soles of the
    model are 7 mm above the skin positions."""
    whole = load_robot("icub-whole")
    sole = whole.patch("left_sole").model_copy(update={"xyz": (0.003, 0.0, 0.0)})
    robot = whole.model_copy(update={"patches": (sole,)})
    (row,) = check_skins(robot)
    assert row["correction"]["mends"]
    assert np.linalg.norm(row["correction"]["xyz_m"]) < 0.012
    assert np.abs(row["correction"]["rpy_deg"]).max() < 3.0
    np.testing.assert_allclose(
        np.subtract(row["mount"]["xyz_m"], row["correction"]["xyz_m"]), [0.003, 0.0, 0.0], atol=1e-3
    )
    told = tmp_path / "told.txt"
    with told.open("w") as file, pytest.MonkeyPatch.context() as patch:
        patch.setattr(skin_check, "console", Console(file=file, width=200))
        skin_check._advise(row)
    assert '<patch name="left_sole" xyz="' in told.read_text()


def test_the_robots_own_skin_and_links_without_meshes() -> None:
    status, text = check("nao", "--json")
    assert status == 0
    assert {row["verdict"] for row in json.loads(text)["skins"]} == {"not checked"}
    assert "has no mesh to compare with" in text


@pytest.mark.parametrize("name", ["alex", "icub-hands", "g1-inspire", "talos", "g1"])
def test_what_check_calls_valid_is_not_called_wrong(name: str) -> None:
    """Pads on a palm of boxes are not judged by the wrist's mesh, and sleeves that are far off are told."""
    rows = check_skins(load_robot(name))
    assert "wrong" not in {row["verdict"] for row in rows}
    loose = [row["skin"] for row in rows if row["verdict"] == "loose"]
    assert loose == (["left_forearm", "right_forearm"] if name == "alex" else [])
    assert all(row["mean_mm"] <= 25.0 for row in rows if row["verdict"] == "fits")


def test_half_a_question_is_refused(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["skin", "check", "icub", "--link", "chest"])
    assert result.exit_code == 1
    assert "--file and --link need each other" in str(result.exception)


def test_a_sleeve_is_measured_against_both_links_that_it_covers() -> None:
    """On most arms the forearm's surface is that of two links, before and after its roll."""
    robot = load_robot("g1")
    sleeve = robot.patch("left_forearm")
    robot = robot.model_copy(update={"patches": (sleeve,)})
    (row,) = check_skins(robot)
    assert row["verdict"] == "fits"
    assert row["link"].split()[:2] == ["left_elbow_link", "left_wrist_roll_link"]
    # A person sees the wrist's housing under the far third of the sleeve.
    (told,) = spans(robot)
    assert "lies over left_wrist_roll_link, which turns against left_elbow_link" in told
    off = sleeve.model_copy(update={"xyz": (0.0, 0.1, 0.0)})
    (row,) = check_skins(robot.model_copy(update={"patches": (off,)}))
    assert row["verdict"] == "wrong"
