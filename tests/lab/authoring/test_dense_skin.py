"""`with_dense_skin` adds taxels to a robot and changes nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from tci.errors import TciError
from tci.lab.authoring.dense_skin import with_dense_skin
from tci.robot.catalogue import load_robot
from tci.skin.skin import Skin


@pytest.mark.parametrize("robot", ["nao", "icub"])
@pytest.mark.parametrize(("taxels", "patches"), [(400, None), (4000, 11), (10_000, 64)])
def test_taxels_and_patches(robot: str, taxels: int, patches: int | None) -> None:
    dense = with_dense_skin(load_robot(robot), taxels, patches=patches)
    assert len(dense.patches) == (patches or 4)
    assert sum(patch.channels for patch in dense.patches) == pytest.approx(taxels, rel=0.05)
    for patch, surface in Skin(dense).surfaces.items():
        assert len(surface.positions) == dense.patch(patch).channels
        assert (surface.neighbours[:, 0] < surface.neighbours[:, 1]).all()


def test_it_lies_where_the_robots_own_skin_lies() -> None:
    robot = load_robot("nao")
    own, dense = Skin(robot).surfaces, Skin(with_dense_skin(robot, 2000)).surfaces
    assert set(dense) == {patch.name for patch in robot.patches if robot.limb_segment(patch)}
    for patch in dense:
        surface = own[patch]
        nearest, _ = dense[patch].project(surface.positions)
        assert np.linalg.norm(nearest - surface.positions, axis=1).max() < 0.003


@pytest.mark.parametrize(("taxels", "patches"), [(30, 4), (100, 0)])
def test_too_little_skin_is_an_error(taxels: int, patches: int) -> None:
    with pytest.raises(TciError, match="valid: a robot with skin, and 9 taxels or more"):
        with_dense_skin(load_robot("nao"), taxels, patches=patches)
