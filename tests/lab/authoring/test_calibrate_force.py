"""A patch is calibrated against a force sensor with realistic recordings: the force has a bias, and the patch
is never unloaded."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers.skin_data import SkinData
from tci.errors import TciError
from tci.lab.authoring.calibrate_force import BLOCK, calibrate_to_force, fit_force, fit_recording
from tci.lab.authoring.force_log import read_force_log
from tci.recording.yarp_log import read_yarp_log
from tci.robot.description import Sensor
from tci.robot.skin_files.calibration import PatchCalibration
from tci.robot.skin_files.file import read_skin_file

TAXELS, FRAMES = 40, 1200
SENSOR = Sensor(rest=240.0, pascal_per_count=-300.0, lowest=0.0, highest=255.0)
AREAS = np.full(TAXELS, 3.7e-4)
AXIS, BIAS = np.array([0.1, -0.2, -0.97]), np.array([-30.0, 12.0, -119.0])


def stand() -> tuple[np.ndarray, ...]:
    """Returns gains, time stamps, raw values, times and forces of a foot on which a robot sways.

    A force/torque sensor with a bias measures the load along an oblique axis. The gains of the taxels differ
    from each other, and their rest values differ from those of the description.
    """
    random = np.random.default_rng(0)
    gains = 1.5 * np.exp(random.normal(0.0, 0.5, TAXELS))
    stamps = 1e9 + 0.02 * np.arange(FRAMES)
    frame, knots = np.arange(FRAMES), np.arange(0, FRAMES + 15, 15)
    x, y = (np.interp(frame, knots, random.uniform(size=len(knots))) for _ in range(2))
    places = random.uniform(size=(TAXELS, 2))
    far = np.hypot(places[:, 0] - x[:, None], places[:, 1] - y[:, None])
    counts = 80.0 * np.clip(np.sin(frame / 90.0), 0.0, None)[:, None] * np.exp(-((far / 0.1) ** 2))
    load = (300.0 * counts * gains) @ AREAS
    rests = SENSOR.rest - random.uniform(0.0, 12.0, TAXELS)
    values = np.clip(np.rint(rests - counts + random.normal(0.0, 0.3, counts.shape)), 0.0, 255.0)
    times = stamps[0] + 0.01 * np.arange(2 * FRAMES)
    felt = np.interp(times, stamps, load)
    forces = BIAS + felt[:, None] * AXIS / np.linalg.norm(AXIS) + random.normal(0.0, 0.05, (len(times), 3))
    return gains, stamps, values, times, forces


def test_gains_and_newtons_are_found_without_bias_or_rest() -> None:
    gains, *recording = stand()
    found, fit = calibrate_to_force(SENSOR, AREAS, *recording)
    assert fit.held_out < 0.5 * fit.held_out_one_gain
    assert fit.held_out < 0.5 * fit.held_out_raw_sum
    assert np.corrcoef(np.log(found.gain), np.log(gains))[0, 1] > 0.6
    assert np.median(np.array(found.gain) / gains) == pytest.approx(1.0, abs=0.1)
    found.check(TAXELS)


def test_equal_taxels_keep_one_gain() -> None:
    """All taxels have the same true gain, so a fit with different gains would only fit noise."""
    random = np.random.default_rng(1)
    parts = random.uniform(size=(200, 30)) * random.uniform(size=(200, 1))
    load = 2.0 * parts.sum(axis=1) + 3.0 + random.normal(0.0, 1.0, 200)
    fit = fit_force(parts, load, np.arange(200) // BLOCK, raw=parts.sum(axis=1))
    np.testing.assert_allclose(fit.gains, 2.0, rtol=0.25)
    assert fit.offset == pytest.approx(3.0, abs=0.5)


def test_a_force_that_has_nothing_to_do_with_the_patch_is_refused() -> None:
    _, stamps, values, times, forces = stand()
    with pytest.raises(TciError, match="does not grow with what the patch reads"):
        calibrate_to_force(SENSOR, AREAS, stamps, np.full_like(values, 200.0), times, forces)
    with pytest.raises(TciError, match="one clock for both"):
        calibrate_to_force(SENSOR, AREAS, stamps, values, times - 1e9, forces)
    values[3, 4] = np.nan
    with pytest.raises(TciError, match="not all finite"):
        calibrate_to_force(SENSOR, AREAS, stamps, values, times, forces)


def test_a_sole_that_never_lifts_keeps_the_description_and_says_so() -> None:
    """The robot stands and shifts its weight from heel to toe: the load stays, the taxels take turns. The
    fit alone gives a fraction of the true gain, and would read a fraction of what stands there."""
    random = np.random.default_rng(3)
    frame = np.arange(FRAMES)
    toe = 0.5 + 0.3 * np.sin(frame / 40.0)[:, None]
    counts = 60.0 * np.where(np.arange(TAXELS) < TAXELS // 2, toe, 1.0 - toe) + 10.0
    load = counts @ AREAS * 300.0 * 0.9
    values = np.rint(240.0 - counts + random.normal(0.0, 0.3, counts.shape))
    stamps = 0.02 * frame
    forces = (load + random.normal(0.0, 3.0, FRAMES))[:, None] * AXIS
    found, _ = calibrate_to_force(SENSOR, AREAS, stamps, values, stamps, forces)
    assert "never unloaded" in str(found.report["not_seen"])
    read = np.array(found.gain) * SENSOR.pressure(np.array(found.rest) - values) @ AREAS
    assert np.median(read / load) == pytest.approx(1.0, abs=0.2)


def test_taxels_that_were_never_pressed_are_told() -> None:
    gains, stamps, values, times, forces = stand()
    still = np.full((len(values), 3), 240.0)
    areas = np.concatenate([AREAS, AREAS[:3]])
    found, _ = calibrate_to_force(SENSOR, areas, stamps, np.hstack([values, still]), times, forces)
    assert str(found.report["not_seen"]).startswith("3 of 43 taxels were never pressed")
    assert found.gain[-3:] == (1.0, 1.0, 1.0)
    assert np.median(np.array(found.gain[:-3]) / gains) == pytest.approx(1.0, abs=0.1)


def test_gains_that_are_no_better_than_the_raw_sum_are_not_kept() -> None:
    """The load is the sum of the raw values, with those that are too small to be felt."""
    _, stamps, values, times, _ = stand()
    load = np.interp(times, stamps, -(values - 240.0).sum(axis=1))
    found, fit = calibrate_to_force(SENSOR, AREAS, stamps, values, times, load[:, None])
    assert fit.held_out > fit.held_out_raw_sum
    assert "the gains stay those of the description" in str(found.report["not_seen"])
    assert set(found.gain) == {1.0}


def test_logs_of_yarp_and_csv_are_read_alike(tmp_path: Path) -> None:
    rows = [(10.0, 1.0, 2.0, -3.0), (10.5, 1.5, 2.5, -3.5)]
    log, table = tmp_path / "data.log", tmp_path / "force.csv"
    log.write_text("".join(f"{n} {row[0]} {row[1]} {row[2]} {row[3]} 0 0 0\n" for n, row in enumerate(rows)))
    table.write_text("time,fx,fy,fz\n" + "\n".join(",".join(map(str, row)) for row in rows))
    for path in (log, tmp_path, table):
        times, forces = read_force_log(path)
        np.testing.assert_array_equal(np.column_stack([times, forces]), rows)
    log.write_text("1 10.0 1 2\n2 10.1 1 2\n")
    with pytest.raises(TciError, match="a force of three axes first"):
        read_force_log(log)


@pytest.mark.parametrize("gain", [(1.0,), (0.0, 1.0), (1.0, -2.0)])
def test_a_gain_is_one_positive_number_a_taxel(gain: tuple[float, ...]) -> None:
    found = PatchCalibration(rest=(1.0, 1.0), noise=(0.0, 0.0), gain=gain, report={})
    with pytest.raises(TciError, match="gains must be 2"):
        found.check(2)


@pytest.mark.parametrize("setup", ["01", "08"])
def test_genuine_feet_are_at_or_below_the_error_of_the_raw_sum(setup: str, genuine_data: SkinData) -> None:
    """The force logs are public (jeljaik/extended-kalman-filter, MIT). The test uses them if they are in the
    folder of the skin recordings."""
    log = genuine_data.file(f"recordings/icub_right_foot_force_{setup}.log")
    if not log.exists():
        pytest.skip(f"{log.name}: analog:o of backwardTipping/dumperTippingSetup{setup} is not there")
    valid = np.flatnonzero(read_skin_file(genuine_data.file("icub/positions/right_foot.txt")).valid)
    skin = genuine_data.file(f"recordings/icub_right_foot_raw_{setup}.log")
    frames = list(read_yarp_log(skin, patch="foot"))
    stamps, values = np.array([one.stamp for one in frames]), np.array([one.values[valid] for one in frames])
    areas = np.full(len(valid), 3.7e-5)
    fit, _, _ = fit_recording(SENSOR, areas, stamps, values, *read_force_log(log))
    print(setup, fit.held_out, fit.held_out_one_gain, fit.held_out_raw_sum)
    # In setup 08 the sum over the sole's taxels decreases to half while the force is constant, so the best
    # fit is a constant.
    assert fit.gains.any() == (setup == "01")
    assert fit.held_out <= (0.5 if setup == "01" else 1.0) * fit.held_out_raw_sum
