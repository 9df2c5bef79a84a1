"""After a calibration with noisy weights, different kinds of skin report equal forces."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.long_skin import COLUMNS, ROWS, TAXELS, bump, conditioner, sensor
from tci.errors import TciError
from tci.lab.authoring.calibrate_skin import Load, calibrate
from tci.lab.authoring.load_skin import _compare
from tci.robot.description import Sensor
from tci.robot.skin_files.calibration import PatchCalibration

AREA = 3e-5
AREAS = np.full(TAXELS, AREA)
INVERTED = sensor(8)
SENSITIVE = Sensor(rest=120.0, pascal_per_count=30.0, lowest=0.0, highest=4095.0)
THREE_AXES = Sensor(rest=4000.0, pascal_per_count=2.0, lowest=0.0, highest=65535.0, axes=3)
"""Sensor for the normal component (z) of a three-axis taxel. Weights do not calibrate the tangential
components x and y."""
WRONG = 1.4
"""Factor by which the response in the description is wrong, so that a skin without calibration fails the
test."""


def truth(of: Sensor, pressure: np.ndarray) -> np.ndarray:
    """Returns the counts of a sensor that saturates gradually: the sum of a linear term and a square-root
    term."""
    full = (of.rest - of.lowest) if of.pascal_per_count < 0 else (of.highest - of.rest)
    share = pressure / 60e3
    return np.sign(of.pascal_per_count) * full * (0.7 * share + 0.3 * np.sqrt(share))


def frames(of: Sensor, force: float, count: int, generator: np.random.Generator) -> np.ndarray:
    """Returns raw frames (count, taxels) with a force `force` [N] on one place of the patch."""
    shape = bump(*generator.uniform((3, 3), (ROWS - 4, COLUMNS - 4)), 1.0, width=generator.uniform(1.2, 1.6))
    pressure = np.where(shape > 0.02, shape, 0.0)
    pressure *= force / (AREA * pressure.sum()) if force else 0.0
    offsets = np.random.default_rng(5).uniform(-4.0, 4.0, TAXELS)
    noise = 0.004 * (of.highest - of.lowest) * generator.standard_normal((count, TAXELS))
    return np.clip(np.rint(of.rest + offsets + truth(of, pressure) + noise), of.lowest, of.highest)


@pytest.mark.parametrize(
    "of", [INVERTED, SENSITIVE, THREE_AXES], ids=["0-255 inverted", "12 bits", "three axes"]
)
def test_a_held_out_newton_is_a_newton(of: Sensor) -> None:
    generator = np.random.default_rng(1)
    weights = np.repeat([0.3, 0.6, 0.9, 1.3, 1.8, 2.5], 4)
    loads = [
        Load(weight * (1.0 + 0.01 * generator.standard_normal()), frames(of, weight, 50, generator))
        for weight in weights
    ]
    found = calibrate(of, AREAS, frames(of, 0.0, 200, generator), loads)
    subject = conditioner(of, calibration=found)
    held = [
        np.mean([subject.pressure(whole(of, values)) @ AREAS for values in frames(of, 1.0, 20, generator)])
        for _ in range(20)
    ]
    assert np.mean(held) == pytest.approx(1.0, abs=0.05)
    assert np.ptp(held) < 0.2


def whole(of: Sensor, values: np.ndarray) -> np.ndarray:
    """Returns a frame in which `values` (taxels,) are normal to the skin. For three-axis taxels, the
    tangential values are zero."""
    frame = np.full((TAXELS, of.axes), of.rest)
    frame[:, -1] = values
    return frame.ravel()


def test_rest_alone_keeps_the_description_s_response() -> None:
    found = calibrate(INVERTED, AREAS, frames(INVERTED, 0.0, 100, np.random.default_rng(2)), [])
    assert found.response == ()
    assert found.noise[0] == pytest.approx(0.004 * 255.0, rel=0.3)


@pytest.mark.parametrize(
    ("rest", "loads", "words"),
    [
        (np.zeros((3, TAXELS)), [], "20 or more frames"),
        (np.full((30, TAXELS), np.nan), [], "not all finite"),
        (np.zeros((30, TAXELS)), [Load(-1.0, np.zeros((3, TAXELS)))], "-1.0 N"),
        (np.zeros((30, TAXELS)), [Load(1.0, np.zeros((3, 7)))], r"\(3, 7\)"),
        (np.zeros((30, TAXELS)), [Load(1.0, np.full((3, TAXELS), np.inf))], "1.0 N are not all finite"),
        (np.zeros((30, TAXELS)), [Load(1.0, np.zeros((3, TAXELS)))], "no taxel reads more"),
    ],
)
def test_data_that_can_t_tell(rest: np.ndarray, loads: list[Load], words: str) -> None:
    with pytest.raises(TciError, match=words):
        calibrate(INVERTED, AREAS, rest, loads)


def test_the_forces_of_the_report_are_what_the_skin_measures() -> None:
    """Conditioning drops counts below seven standard deviations of the noise; the report counted them from
    three on."""
    sensor = Sensor(rest=240.0, pascal_per_count=-1000.0, lowest=0.0, highest=255.0)
    found = PatchCalibration(
        rest=(240.0, 240.0), noise=(1.0, 1.0), response=((0.0, 0.0), (9.0, 18e3)), report={}
    )
    load = Load(force=10.0, values=np.array([[231.0, 235.0]]))  # 9 and 5 counts
    row = _compare(sensor, np.full(2, 1e-4), found, load)
    assert row["before_N"] == pytest.approx(0.9)
    assert row["after_N"] == pytest.approx(1.8)
