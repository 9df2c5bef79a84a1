"""Tests `tci skin`: cones that are fitted to skins, and pictures of skins."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from matplotlib.image import imread
from typer.testing import CliRunner

from helpers.made_skins import LENGTH, RIPPLE, SKINS
from helpers.skin_data import SkinData, cone_file
from tci.cli.main import app
from tci.errors import CommandError, DescriptionError, TciError
from tci.lab.authoring.skin_map import best_cone, skin_cone, unroll
from tci.lab.authoring.skin_picture import maps
from tci.robot.skin_files.file import read_skin_file

FOREARM = (np.cos(np.deg2rad(15.0)), 0.0, np.sin(np.deg2rad(15.0)))
FIGURES = [
    # File, axis and origin; then, for each kind of fit: length [mm], RMS and largest error [mm].
    (
        "icub/positions_pycub/left_forearm.txt", FOREARM, (0.0, 0.0, 0.0),
        {"none": (90, 5.2, 11.8), "centre": (90, 3.2, 7.2), "axis": (99, 2.6, 7.1)},
    ),
    (
        "icub/positions_pycub/right_forearm.txt", (-FOREARM[0], 0.0, FOREARM[2]), (0.0, 0.0, 0.0),
        {"none": (90, 5.1, 10.6), "centre": (90, 3.2, 7.2), "axis": (99, 2.6, 7.1)},
    ),
    (
        "icub/positions/left_arm.txt", (0.0, 0.0, 1.0), (-0.015, 0.0, 0.0),
        {"none": (111, 4.5, 8.0), "axis": (124, 3.4, 9.5)},
    ),
    ("nao/positions/nao_left_hand.txt", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), {"axis": (88, 0.5, 1.8)}),
    ("nao/positions/nao_right_hand.txt", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), {"axis": (92, 0.28, 1.1)}),
]  # fmt: skip


def tci(*arguments: str) -> str:
    run = CliRunner().invoke(app, ["skin", *arguments], catch_exceptions=False)
    if run.exception is not None:
        raise run.exception
    return run.stdout


@pytest.mark.parametrize(("name", "axis", "origin", "figures"), FIGURES, ids=lambda value: str(value)[:40])
def test_cones_through_genuine_skins(
    name: str, axis: object, origin: object, figures: dict, genuine_data: SkinData
) -> None:
    skin = read_skin_file(genuine_data.file(name))
    for free, (length, rms, largest) in figures.items():
        fit = skin_cone(skin.positions[skin.taxels], origin=np.array(origin), axis=np.array(axis), free=free)
        assert fit.length * 1e3 == pytest.approx(length, abs=1.0)
        assert fit.rms * 1e3 == pytest.approx(rms, abs=0.1)
        assert fit.largest * 1e3 == pytest.approx(largest, abs=0.2)


@pytest.mark.parametrize("free", ["none", "axis"])
@pytest.mark.parametrize("name", ["icub/positions/left_arm", "nao/positions/nao_left_hand"])
def test_cones_through_made_skins_lie_midway_between_their_modules(
    name: str, free: Literal["none", "axis"], made_data: SkinData
) -> None:
    """Every second module of the made skin lies deeper by RIPPLE, so a fitted cone lies midway between the
    two groups of modules."""
    made, skin = SKINS[name], read_skin_file(made_data.file(f"{name}.txt"))
    positions = skin.positions[skin.taxels]
    fit = skin_cone(positions, origin=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), free=free)
    ends = np.array([positions[:, 2].min(), positions[:, 2].max()])
    radii = made.r1 + (made.r2 - made.r1) / LENGTH * ends - RIPPLE / 2
    assert fit.length == pytest.approx(np.ptp(ends), abs=0.2e-3)
    np.testing.assert_allclose([fit.r1, fit.r2], radii, atol=0.3e-3)
    assert fit.rms == pytest.approx(RIPPLE / 2, rel=0.1)
    assert fit.largest < RIPPLE


def test_fit_of_a_written_cone(tmp_path: Path) -> None:
    file = str(cone_file(tmp_path / "skin.txt"))
    assert "free axis" in tci("fit", file)
    data = json.loads(tci("fit", file, "--json"))
    assert data["taxels"] == 160
    for cone in data["cones"]:
        assert cone["rms_mm"] < 0.01
        assert (cone["r1_mm"], cone["r2_mm"]) == pytest.approx((40.0, 30.0), abs=0.1)
    moved = json.loads(tci("fit", file, "--json", "--origin", "0.01", "0", "0"))["cones"]
    assert moved[0]["rms_mm"] > 1.0
    assert moved[1]["rms_mm"] < 0.01


def test_a_flat_skin_has_no_cone(tmp_path: Path) -> None:
    file = tmp_path / "flat.txt"
    file.write_text("\n".join(f"{i % 6 / 100} {i // 6 / 100} 0.01" for i in range(24)))
    cones = json.loads(tci("fit", str(file), "--json", "--axis", "1", "0", "0"))["cones"]
    assert "flat" in cones[1]["error"]
    assert "none" in tci("fit", str(file), "--axis", "1", "0", "0")
    picture = tmp_path / "flat.png"
    tci("show", str(file), "--out", str(picture))
    assert imread(picture).std() > 0.05


def test_bad_input_is_one_clear_error(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="can't be opened"):
        tci("fit", str(tmp_path / "none.txt"))
    with pytest.raises(TciError, match="icub"):
        tci("show", "naoo")
    file = str(cone_file(tmp_path / "skin.txt"))
    with pytest.raises(TciError, match="can't be written"):
        tci("show", file, "--out", str(tmp_path / "skin.nonsense"))
    assert "no direction" in tci("fit", file, "--axis", "0", "0", "0").replace("\n", " ")


@pytest.mark.parametrize("robot", ["nao", "g1-inspire"])
def test_a_picture_of_a_whole_robot_fits_a_screens_width_and_is_not_half_empty(
    robot: str, tmp_path: Path
) -> None:
    tci("show", robot, "--out", str(tmp_path / "skin.png"))
    ink = imread(tmp_path / "skin.png")[..., :3].min(axis=2) < 1.0
    height, width = ink.shape
    assert width <= 1800
    assert height <= 3000
    empty = np.diff(np.flatnonzero(np.concatenate([[True], ink.any(axis=1), [True]])))
    assert empty.max() < 100
    filled = [ink[y : y + 40, x : x + 40].any() for y in range(0, height, 40) for x in range(0, width, 40)]
    assert np.mean(filled) > 0.6


def test_a_head_in_skin_is_unrolled(tmp_path: Path) -> None:
    """Seen from one side, front and back of a closed skin would lie upon each other."""
    (head,) = (one for one in maps("icub-whole") if "head" in one.title)
    places = np.column_stack([head.across, head.along_up])
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 1e3 * np.eye(len(places))
    assert not head.flat
    assert apart.min() > 5.0  # mm


def test_show_numbers_every_taxel(tmp_path: Path) -> None:
    file = cone_file(tmp_path / "skin.txt")
    picture = tmp_path / "new" / "skin.png"
    assert "160 taxels" in tci("show", str(file), "--out", str(picture))
    assert imread(picture).std() > 0.05
    (one,) = maps(str(file))
    assert one.channels.tolist() == [c for c in range(192) if c % 12 not in (6, 10)]
    assert {m.title for m in maps("nao")} >= {"nao left_forearm"}


def test_unrolling_keeps_place_and_angle(tmp_path: Path) -> None:
    skin = read_skin_file(cone_file(tmp_path / "skin.txt"))
    positions = skin.positions[skin.taxels]
    fit = skin_cone(positions, origin=np.zeros(3), axis=np.array([0.0, 0.0, 1.0]), free="none")
    x, theta = unroll(positions, fit)
    np.testing.assert_allclose(x, positions[:, 2] - positions[:, 2].min(), atol=1e-9)
    np.testing.assert_allclose(np.cos(theta - np.arctan2(positions[:, 1], positions[:, 0])), 1.0, atol=1e-9)
    best = best_cone(positions)
    assert best is not None
    assert best.rms < 1e-5


def test_fit_of_a_robots_own_skin() -> None:
    result = CliRunner().invoke(app, ["skin", "fit", "nao", "--json"])
    told = {one["name"]: one for one in json.loads(result.output)["skins"]}
    sides, segments = ("left", "right"), ("forearm", "upper_arm")
    assert set(told) == {f"{side}_{segment}" for side in sides for segment in segments}
    kinematic = told["left_forearm"]["cones"][0]
    assert (kinematic["r1_mm"], kinematic["r2_mm"]) == pytest.approx((37.0, 43.0))
    assert kinematic["rms_mm"] < 1e-6
    with pytest.raises(CommandError, match="are for skin files only"):
        CliRunner().invoke(app, ["skin", "fit", "nao", "--axis", "0", "0", "1"], catch_exceptions=False)
