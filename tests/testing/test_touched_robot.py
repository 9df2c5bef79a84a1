"""The public helper for tests of capabilities: the perceived touch equals the requested touch."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.errors import CommandError, UnknownNameError
from tci.messages import Landmark
from tci.testing import TouchedRobot, perception
from tci.testing.touched_robot import PERIOD

NAO = tci.load_robot("nao")


@pytest.mark.parametrize("patch", [patch.name for patch in NAO.patches])
def test_a_touch_of_each_patch_is_one_contact_there(patch: str) -> None:
    (contact,) = perception(NAO, patch, force=4.0).contacts
    words = NAO.patch(patch)
    assert (contact.patch, contact.part, contact.segment) == (patch, words.part, words.segment)
    switch = words.sensor.highest - words.sensor.lowest <= 1.0
    assert contact.force == pytest.approx(1.0 if switch else 4.0, rel=0.1)


@pytest.mark.parametrize("patch", [patch.name for patch in NAO.patches])
def test_a_touch_without_force_is_none(patch: str) -> None:
    assert not perception(NAO, patch, force=0.0).contacts


def test_without_a_touch_nothing_is_felt() -> None:
    seen = perception("nao")
    assert not seen.contacts
    assert [*seen.posture] == [part.name for part in NAO.parts]


@pytest.mark.parametrize("taxel", [0, 100, 231])
def test_a_taxel_is_in_the_middle_of_its_touch(taxel: int) -> None:
    robot = TouchedRobot(NAO)
    (contact,) = robot.perceive("left_forearm", taxel=taxel, force=3.0).contacts
    assert taxel in contact.taxels
    place = robot.body.skin.surfaces["left_forearm"].positions[taxel]
    assert np.linalg.norm(contact.p_L - place) < 0.01


def test_a_touch_keeps_its_identity_until_it_ends() -> None:
    robot = TouchedRobot(NAO)
    first, second, after = (robot.perceive(touch) for touch in ("left_forearm", "left_forearm", None))
    assert first.contacts[0].identity == second.contacts[0].identity
    assert second.contacts[0].onset == first.stamp
    assert after.stamp - first.stamp == pytest.approx(2 * PERIOD)
    assert after.ended == (first.contacts[0].identity,)


def test_a_perception_answers_what_one_of_a_robot_answers() -> None:
    posture = np.deg2rad([20.0, 30.0, 10.0, 50.0, 0.0])
    seen, body = perception(NAO, "left_forearm", posture={"left_arm": posture}), GenericBody(NAO)
    np.testing.assert_allclose(seen.posture["left_arm"], posture, atol=1e-6)
    assert body.jacobian(seen, seen.contacts[0]).shape == (3, 5)
    assert 0.0 < body.distance(seen.contacts[0], Landmark("forearm", (1.0, 0.0, 0.0))) < 0.5
    assert body.has_joint("head").tolist() == [True, False, True]


def test_three_axis_skin_feels_it_along_its_normal() -> None:
    patch = NAO.patch("left_forearm")
    three = {"axes": 3, "rest": 30000.0, "lowest": 0.0, "highest": 65535.0, "pascal_per_count": 4.0}
    sensor = patch.sensor.model_copy(update=three)
    skin = patch.model_copy(update={"sensor": sensor, "channels": 3 * patch.channels})
    (contact,) = perception(NAO.model_copy(update={"patches": (skin,)}), "left_forearm", force=3.0).contacts
    assert contact.force == pytest.approx(3.0, rel=0.03)  # counts are whole
    assert float(contact.f_T @ contact.n_T) == pytest.approx(-np.linalg.norm(contact.f_T), rel=0.01)


def test_what_can_not_be_touched_is_said() -> None:
    with pytest.raises(
        UnknownNameError, match=r"no skin patch named 'left_foream' \(did you mean 'left_forearm'\?\)"
    ):
        perception(NAO, "left_foream")
    with pytest.raises(UnknownNameError, match="no taxel of left_forearm named '999'; valid: 0 to "):
        perception(NAO, "left_forearm", taxel=999)
    with pytest.raises(CommandError, match="a touch of nan N; valid: 0 or more, finite"):
        perception(NAO, "left_forearm", force=float("nan"))
