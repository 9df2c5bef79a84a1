"""Positions of taxels are estimated from touches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from helpers.command_line import tci
from tci.errors import TciError
from tci.lab.authoring.locate_taxels import ProbeTouch, locate_taxels
from tci.lab.experiments.self_calibration import calibrate_in_simulation
from tci.robot.catalogue import load_robot


@pytest.mark.parametrize("patch", ["left_forearm", "right_upper_arm"])
@pytest.mark.parametrize("name", ["nao", "icub"])
def test_200_touches_mend_10_mm(name: str, patch: str) -> None:
    done = calibrate_in_simulation(load_robot(name), patch, touches=200, wrong=0.010, seed=3)
    before, after = 1e3 * np.median(done.before), 1e3 * np.median(done.after)
    print(f"{name} {patch}: {before:.1f} mm before, {after:.2f} mm after")
    assert done.touches == 200
    assert before == pytest.approx(10.0)
    assert after < 2.0
    assert 1e3 * np.quantile(done.after, 0.9) < 6.0
    right = np.einsum("ij,ij->i", done.located.normals, done.located.normals) > 0.5
    assert right.mean() > 0.9


def test_taxels_of_three_axes_are_found_by_what_presses_them() -> None:
    nao = load_robot("nao")
    patch = nao.patch("left_forearm")
    sensor = patch.sensor.model_copy(
        update={"axes": 3, "rest": 30000.0, "lowest": 0.0, "highest": 65535.0, "pascal_per_count": 4.0}
    )
    skin = patch.model_copy(update={"sensor": sensor, "channels": 3 * patch.channels})
    robot = nao.model_copy(update={"patches": (skin,)})
    done = calibrate_in_simulation(robot, "left_forearm", touches=100, seed=3)
    assert np.median(done.after) < 0.3 * np.median(done.before)


def test_three_taxels_make_no_surface() -> None:
    with pytest.raises(TciError, match="head: its 3 taxels form no surface"):
        calibrate_in_simulation(load_robot("nao"), "head", touches=3)


def plane(count: int, *, seed: int) -> tuple[np.ndarray, list[ProbeTouch]]:
    """Returns a flat skin of 8 x 8 taxels with a pitch of 6 mm, and touches to which the taxels respond as
    ideal Gaussians."""
    generator = np.random.default_rng(seed)
    grid = 0.006 * np.arange(8)
    places = np.array([(x, y, 0.0) for x in grid for y in grid])
    touches = []
    for point in generator.uniform(0.0, 0.042, (count, 2)):
        away = places - np.append(point, 0.0)
        answers = 1e4 * np.exp(-0.5 * np.einsum("ij,ij->i", away, away) / 0.004**2)
        touches.append(ProbeTouch(np.append(point, 0.0), np.array([0.0, 0.0, 1.0]), answers))
    return places, touches


def test_ideal_answers_give_the_places_and_their_width() -> None:
    places, touches = plane(120, seed=1)
    shift = np.random.default_rng(2).normal(0.0, 0.004, places.shape)
    located = locate_taxels(touches, places + shift)
    inner = np.all((places[:, :2] > 0.005) & (places[:, :2] < 0.037), axis=1)
    errors = np.linalg.norm(located.positions - places, axis=1)
    assert np.median(errors[inner]) < 0.0007
    assert located.width == pytest.approx(0.004, rel=0.15)
    np.testing.assert_allclose(
        located.normals[located.touches > 0], [[0.0, 0.0, 1.0]] * (located.touches > 0).sum()
    )


def test_a_taxel_that_never_answers_stays() -> None:
    places, touches = plane(40, seed=1)
    touches = [ProbeTouch(t.point, t.normal, np.where(np.arange(64) == 5, 0.0, t.answers)) for t in touches]
    located = locate_taxels(touches, places + 0.001)
    assert located.touches[5] == 0
    np.testing.assert_array_equal(located.positions[5], places[5] + 0.001)


def test_what_does_not_fit_is_refused() -> None:
    places, touches = plane(5, seed=1)
    with pytest.raises(TciError, match="2 touches were felt; valid: 3 or more"):
        locate_taxels(touches[:2], places)
    with pytest.raises(TciError, match="another number of answers than the 63 taxels"):
        locate_taxels(touches, places[1:])


def test_from_a_file_of_touches(tmp_path: Path) -> None:
    (tmp_path / "touches.csv").write_text("1,2,3\n")
    told = tci(
        "skin",
        "locate",
        "nao",
        "--patch",
        "left_forearm",
        "--touches",
        str(tmp_path / "touches.csv"),
        status=1,
    )
    assert "3 numbers in a row; valid: 246" in told
