"""Skin that measures the direction of a force reports the force vector of the simulation."""

from __future__ import annotations

import numpy as np
import pytest

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.messages import Reading
from tci.robot.description import Robot
from tci.simulation.world import World
from tci.skin.shear import Shear

PATCH = "left_forearm"


@pytest.fixture(scope="module")
def robot() -> Robot:
    """Returns a NAO whose left sleeve measures three axes with 16 bits."""
    nao = tci.load_robot("nao")
    patch = nao.patch(PATCH)
    sensor = patch.sensor.model_copy(
        update={"axes": 3, "rest": 30000.0, "lowest": 0.0, "highest": 65535.0, "pascal_per_count": 4.0}
    )
    skin = patch.model_copy(update={"sensor": sensor, "channels": 3 * patch.channels})
    return nao.model_copy(update={"patches": (skin,)})


@pytest.mark.parametrize(("servo", "by"), [("", 0.0), ("LElbowRoll", -0.05), ("LElbowYaw", 0.03)])
def test_the_force_of_a_contact_has_the_physics_direction(robot: Robot, servo: str, by: float) -> None:
    """A finger presses the skin, then the arm moves a little under the finger."""
    world = World(robot)
    world.finger.poke(PATCH, 130, speed=0.1, depth=0.01)
    perceiver = Perceiver(GenericBody(robot))
    perceiver.step(Reading(world.joints(), world.frames()), world.time)
    world.advance(0.25)
    if servo:
        index = [one.name for one in robot.servos].index(servo)
        world.set_position_targets([index], [world.joints().position[index] + by])
    most = 0.0
    for frame in range(1, 16):
        world.advance(0.25 + 0.01 * frame)
        (contact,) = perceiver.step(Reading(world.joints(), world.frames()), world.time).contacts
        truth = world.contact_truth(PATCH)
        sideways = truth.vector - (truth.vector @ truth.normal) * truth.normal
        most = max(most, float(np.linalg.norm(sideways)) / truth.force)
        assert np.linalg.norm(contact.f_T - truth.vector) < 0.08 * np.linalg.norm(truth.vector)
        assert contact.force == pytest.approx(truth.force, rel=0.05)
    assert (most > 0.2) == bool(servo)


def test_it_is_felt_by_an_untouched_skin_as_nothing(robot: Robot) -> None:
    world = World(robot, noise=3.0)
    perceiver = Perceiver(GenericBody(robot))
    for period in range(1, 50):
        world.advance(0.01 * period)
        seen = perceiver.step(Reading(world.joints(), world.frames()), world.time)
        assert not seen.contacts
    assert seen.skin is not None
    assert seen.skin.vector is not None
    assert np.abs(seen.skin.vector).max(initial=0.0) < 0.01


def test_rest_values_are_learnt_and_bad_values_are_rest(robot: Robot) -> None:
    surface = World(robot, skin=(PATCH,)).surfaces[PATCH]
    shear = Shear(robot.patch(PATCH), surface)
    taxels = len(surface.positions)
    offset = np.full(3 * taxels, 30250.0)  # every x and y value has an offset of 250 counts
    for frame in range(5):
        assert not shear.force(offset, np.zeros(taxels), 0.01 * frame).any()
    pressure = np.zeros(taxels)
    pressure[7] = 1000.0
    pushed = offset.copy()
    pushed[3 * 7] += 500.0
    force = shear.force(pushed, pressure, 0.05)
    expected = surface.areas[7] * (500.0 * 4.0 * np.linalg.norm(force[7] / force[7]) / np.sqrt(3.0))
    along = force[7] + surface.areas[7] * 1000.0 * surface.normals[7]
    assert np.linalg.norm(along) == pytest.approx(expected)
    assert along @ surface.normals[7] == pytest.approx(0.0, abs=1e-12)
    assert not np.delete(force, 7, axis=0).any()
    pushed[3 * 7] = np.nan
    pushed[3 * 7 + 1] = 1e6
    np.testing.assert_allclose(
        shear.force(pushed, pressure, 0.06)[7], -surface.areas[7] * 1000.0 * surface.normals[7], atol=1e-12
    )
