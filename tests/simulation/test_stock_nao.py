"""A NAO without sleeves: the switches on its head and hands are skin like any other."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.interface.body import Body
from tci.messages import Contact, Reading
from tci.simulation.world import World

SWITCHES = ("head", "left_hand", "right_hand")


@pytest.fixture(scope="module")
def world() -> World:
    return World(tci.load_robot("nao"), skin=SWITCHES)


def pressed(world: World, patch: str, taxel: int) -> tuple[Contact, ...]:
    """Contacts while a finger presses a switch."""
    world.reset()
    world.finger.poke(patch, taxel, speed=0.1, depth=0.004)
    body = Body(world.robot)
    body.perceive(Reading(world.joints(), world.frames()), world.time)
    world.advance(0.3)
    return body.perceive(Reading(world.joints(), world.frames()), world.time).contacts


@pytest.mark.parametrize("patch", SWITCHES)
@pytest.mark.parametrize("taxel", range(3))
def test_a_press_is_felt_where_it_is_and_nowhere_else(world: World, patch: str, taxel: int) -> None:
    (contact,) = pressed(world, patch, taxel)
    assert (contact.patch, contact.segment, contact.taxels.tolist()) == (patch, "", [taxel])
    assert contact.part == {"head": "head", "left_hand": "left_arm", "right_hand": "right_arm"}[patch]
    truth = world.contact_truth(patch)
    np.testing.assert_allclose(contact.p_T, truth.center, atol=0.012)  # anywhere on the switch
    assert contact.n_T @ truth.normal > 0.9
    assert contact.force == pytest.approx(1.0, rel=0.01)  # a switch knows no more than that it is pressed
    assert np.isnan([contact.u, contact.theta, *contact.taxel_u, *contact.taxel_theta]).all()


def test_it_pushes_with_a_jacobian_and_no_arm_field_answers(world: World) -> None:
    (contact,) = pressed(world, "left_hand", 1)
    body = Body(world.robot)
    assert body.jacobian(contact, world.joints().position).shape == (3, 5)
    perception = body.perceive(Reading(world.joints(), world.frames()), world.time)
    reflex = tci.WithdrawalReflex()
    commands, _ = reflex.step(reflex.init(), perception)
    assert commands == ()


def test_a_robot_without_sleeves_sends_no_frames_of_them(world: World) -> None:
    assert {frame.patch for frame in world.frames()} == set(SWITCHES)
    state = Body(world.robot).skin.update(Reading(world.joints(), world.frames()))
    assert set(state.patches) == set(SWITCHES)
