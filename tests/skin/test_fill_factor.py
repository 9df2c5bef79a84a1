"""The fill factor: the fraction of the surface that taxels measure, and the force that follows from it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import tci
from tci.skin.fill_factor import WIDTHS, fill_factors
from tci.skin.skin import Skin
from tci.skin.surfaces import Surface, find_neighbours

RADIUS, PITCH = 0.04, 0.006


@pytest.fixture(scope="module")
def sleeve() -> Surface:
    """Returns a cylinder without gaps, with square taxels of 6 mm, a radius of 40 mm and a length of 180
    mm."""
    around, along = round(2.0 * np.pi * RADIUS / PITCH), 30
    theta, x = (
        grid.ravel() for grid in np.meshgrid(np.arange(around) * 2 * np.pi / around, np.arange(along))
    )
    normals = np.column_stack([np.cos(theta), np.sin(theta), np.zeros(len(theta))])
    positions = RADIUS * normals + np.column_stack([0 * x, 0 * x, PITCH * x])
    size = len(positions)
    return Surface(
        "sleeve", "link", positions, normals, np.full(size, 2 * np.pi * RADIUS / around * PITCH),
        np.arange(size), find_neighbours(positions, normals), np.zeros((0, 3), np.intp),
    )  # fmt: skip


def test_a_skin_without_gaps_has_a_fill_factor_of_one_but_at_its_ends(sleeve: Surface) -> None:
    factors, z = fill_factors(sleeve), sleeve.positions[:, 2]
    middle = (z > 0.05) & (z < 0.12)
    np.testing.assert_allclose(factors[middle], 1.0, atol=0.03)
    ends = (z == 0.0) | (z == z.max())
    np.testing.assert_allclose(factors[ends][:, -1], 0.5, atol=0.1)
    assert (factors[ends][:, 1:] < factors[middle][:, 1:].min(axis=0)).all()


def test_gaps_are_seen_at_the_width_of_the_touch(sleeve: Surface) -> None:
    """Every second strip of 18 mm has no taxels. A narrow touch on a strip with taxels touches no gap. Half
    of the area of a wide touch is gaps."""
    on = (sleeve.positions[:, 2] / PITCH).round().astype(int) // 3 % 2 == 0
    some = replace(
        sleeve, positions=sleeve.positions[on], normals=sleeve.normals[on], areas=sleeve.areas[on],
        channels=sleeve.channels[on],
    )  # fmt: skip
    z = some.positions[:, 2]
    factors = fill_factors(some)[np.abs(z - np.median(z)) < 0.03]
    sharp, wide = factors.mean(axis=0)[[0, -1]]
    assert sharp > 0.9
    assert wide == pytest.approx(0.5, abs=0.1)
    assert (np.diff(factors.mean(axis=0)) < 0.0).all()


def test_switches_and_sheets_are_not_corrected() -> None:
    nao = tci.load_robot("nao")
    skin = Skin(nao)
    for patch in ("head", "left_hand"):
        np.testing.assert_array_equal(fill_factors(skin.surfaces[patch]), np.ones((3, len(WIDTHS))))
