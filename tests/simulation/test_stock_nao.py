"""A NAO without skin sleeves: the switches on its head, hands and feet are skin patches like any other."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.messages import Perception, Reading
from tci.simulation.world import World

SWITCHES = ("head", "left_hand", "right_hand")
BUMPERS = ("left_bumper", "right_bumper")
PARTS = {
    "head": "head", "left_hand": "left_arm", "right_hand": "right_arm",
    "left_bumper": "left_leg", "right_bumper": "right_leg",
}  # fmt: skip


@pytest.fixture(scope="module")
def world() -> World:
    return World(tci.load_robot("nao"), skin=SWITCHES)


@pytest.fixture(scope="module")
def whole() -> World:
    """Returns the world of a NAO with legs."""
    return World(tci.load_robot("nao-whole"), skin=(*SWITCHES, *BUMPERS))


def pressed(world: World, patch: str, taxel: int) -> Perception:
    """Presses a switch with the finger and returns the perception."""
    world.reset()
    world.finger.poke(patch, taxel, speed=0.1, depth=0.004)
    perceiver = Perceiver(GenericBody(world.robot))
    perceiver.step(Reading(world.joints(), world.frames()), world.time)
    world.advance(0.3)
    return perceiver.step(Reading(world.joints(), world.frames()), world.time)


def check_press(world: World, patch: str, taxel: int) -> None:
    (contact,) = pressed(world, patch, taxel).contacts
    assert (contact.patch, contact.segment, contact.taxels.tolist()) == (patch, "", [taxel])
    assert contact.part == PARTS[patch]
    truth = world.contact_truth(patch)
    np.testing.assert_allclose(contact.p_T, truth.center, atol=0.012)  # anywhere on the switch
    assert contact.n_T @ truth.normal > 0.9
    assert contact.force == pytest.approx(1.0, rel=0.01)  # a switch reports only if it is pressed
    assert np.isnan([contact.u, contact.theta, *contact.taxel_u, *contact.taxel_theta]).all()


@pytest.mark.parametrize("patch", SWITCHES)
@pytest.mark.parametrize("taxel", range(3))
def test_a_press_is_felt_where_it_is_and_nowhere_else(world: World, patch: str, taxel: int) -> None:
    check_press(world, patch, taxel)


@pytest.mark.parametrize("patch", BUMPERS)
@pytest.mark.parametrize("taxel", range(2))
def test_a_foot_that_bumps_into_something_feels_with_which_side(whole: World, patch: str, taxel: int) -> None:
    check_press(whole, patch, taxel)


def test_bumpers_are_at_the_tips_of_the_feet_the_left_one_on_the_left() -> None:
    """The published position of the bumpers of a standing robot is 87.6 mm in front of the ankle and 35.3 mm
    below it."""
    robot = tci.load_robot("nao-whole")
    skin = GenericBody(robot).skin
    ankle = {"left_bumper": "LFoot", "right_bumper": "RFoot"}
    for patch, sides in zip(BUMPERS, ((0.019, -0.014), (0.014, -0.019)), strict=True):
        assert robot.patch(patch).link == ankle[patch]
        surface = skin.surfaces[patch]
        assert surface.channels.tolist() == [0, 1]
        np.testing.assert_allclose(surface.positions, [(0.0876, y, -0.0353) for y in sides], atol=1e-9)
        np.testing.assert_allclose(surface.normals, [(1.0, 0.0, 0.0)] * 2, atol=1e-9)


def test_a_bumper_pushes_with_the_jacobian_of_its_leg(whole: World) -> None:
    seen = pressed(whole, "right_bumper", 0)
    jacobian = GenericBody(whole.robot).jacobian(seen, seen.contacts[0])
    assert jacobian.shape == (3, 6)
    # the pitch joint of the hip moves the foot, its yaw joint is held
    assert np.linalg.norm(jacobian[:, 0]) > 0.1
    assert not jacobian[:, 2].any()


def test_it_pushes_with_a_jacobian_and_no_arm_field_answers(world: World) -> None:
    seen, body = pressed(world, "left_hand", 1), GenericBody(world.robot)
    assert body.jacobian(seen, seen.contacts[0]).shape == (3, 5)
    reflex = tci.WithdrawalReflex()
    commands, _ = reflex.step(reflex.init(body), seen, body)
    assert commands == ()


def test_a_robot_without_sleeves_sends_no_frames_of_them(world: World) -> None:
    assert {frame.patch for frame in world.frames()} == set(SWITCHES)
    seen = Perceiver(GenericBody(world.robot)).step(Reading(world.joints(), world.frames()), world.time)
    assert seen.skin is not None
    assert set(seen.skin.by_patch(patch.name for patch in world.robot.patches)) == set(SWITCHES)
