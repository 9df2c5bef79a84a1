"""A calibration file is stored next to the description. An invalid calibration is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from helpers import small_robot
from helpers.felt_skin import FeltSkin
from tci.errors import DescriptionError, TciError, UnknownNameError
from tci.robot.json_file import read_json, write_json
from tci.robot.skin_files.calibration import (
    PatchCalibration,
    SkinCalibration,
    calibration_path,
)


def made(taxels: int, *, robot: str = "small", patch: str = "left_arm_forearm") -> SkinCalibration:
    one = PatchCalibration(
        rest=(230.0,) * taxels,
        noise=(0.5,) * taxels,
        response=((0.0, 0.0), (10.0, 1e3)),
        report={"loads": 1.0},
    )
    return SkinCalibration(robot=robot, date="2026-01-01", patches={patch: one})


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = calibration_path(tmp_path / "robot.xml")
    write_json(path, made(12))
    assert path.name == "robot.skin.json"
    assert read_json(path, SkinCalibration) == made(12)


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"robot": 3}', "\x00", '{"robot":"a","x":NaN}'])
def test_damaged_file_gets_one_error(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.skin.json"
    path.write_text(text)
    with pytest.raises(DescriptionError, match=r"robot\.skin\.json"):
        read_json(path, SkinCalibration)


def test_absent_file(tmp_path: Path) -> None:
    with pytest.raises(DescriptionError, match="can't be read"):
        read_json(tmp_path / "none.json", SkinCalibration)


def test_skin_takes_its_rest_values_from_it(tmp_path: Path) -> None:
    robot = small_robot.build(tmp_path)
    skin = FeltSkin(robot, calibration=made(small_robot.TAXELS))
    name = "left_arm_forearm"
    state = skin.update(small_robot.reading(small_robot.frame(name, {7: 20})))
    felt = state[name].pressure
    assert felt.max() == pytest.approx((20.0 - (small_robot.REST - 230.0)) * 100.0)
    assert (felt > 0.0).sum() == 1


def test_without_a_measured_response_the_description_s_curve_holds(tmp_path: Path) -> None:
    robot = small_robot.build(tmp_path)
    name = "left_arm_forearm"
    curve = ((0.0, 0.0), (10.0, 500.0), (20.0, 4000.0))
    patches = tuple(
        patch.model_copy(update={"sensor": patch.sensor.model_copy(update={"response": curve})})
        for patch in robot.patches
    )
    robot = robot.model_copy(update={"patches": patches})
    measured = made(small_robot.TAXELS)
    for response, pressure in ((((0.0, 0.0), (10.0, 1e3)), 1500.0), ((), 2250.0)):
        one = measured.patches[name].model_copy(update={"response": response})
        skin = FeltSkin(robot, calibration=measured.model_copy(update={"patches": {name: one}}))
        state = skin.update(small_robot.reading(small_robot.frame(name, {7: 25})))
        # 15 counts above the measured rest value
        assert state[name].pressure.max() == pytest.approx(pressure)


def test_calibration_of_another_skin_is_refused(tmp_path: Path) -> None:
    robot = small_robot.build(tmp_path)
    with pytest.raises(TciError, match="'nao'"):
        FeltSkin(robot, calibration=made(small_robot.TAXELS, robot="nao"))
    with pytest.raises(UnknownNameError, match="tail"):
        FeltSkin(robot, calibration=made(small_robot.TAXELS, patch="tail"))
    with pytest.raises(TciError, match="3 taxels"):
        FeltSkin(robot, calibration=made(3))
