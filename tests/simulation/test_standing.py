"""A simulated standing robot: the soles measure its weight, and the legs do not collapse."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.skin_data import SkinData
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError
from tci.messages import Contact, JointReading, Landmark, Reading, SkinFrame
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.gravity import Gravity
from tci.robot.joint_map import generic_posture, initial_position
from tci.runtime.loop import Tick, run
from tci.simulation.world import World

ROBOTS = {name: load_robot(name) for name in ("nao-whole", "icub-whole")}
NAMES = pytest.mark.parametrize("name", ROBOTS)
SOLE = "right_sole"
SHIN = Landmark("shank", (1.0, 0.0, 0.0))
LEAN = {"nao-whole": 20.0, "icub-whole": 11.0}
"""Angle [degrees] of hips and ankles that moves the weight over the right foot."""


def standing(name: str, *, lean: float = 0.0) -> World:
    """Returns a world in which the robot stands at rest and leans to its right by `lean` [rad]."""
    robot = ROBOTS[name]
    legs = {side: np.array(robot.part(f"{side}_leg").initial_posture) for side in ("left", "right")}
    legs["left"] += lean * np.array([0, 1, 0, 0, 0, 1])
    legs["right"] -= lean * np.array([0, 1, 0, 0, 0, 1])
    world = World(robot, stands=True, posture={f"{side}_leg": angles for side, angles in legs.items()})
    world.advance(1.0)
    return world


def tilt(world: World) -> float:
    """Returns the angle [rad] between the torso and the vertical."""
    return float(np.arccos(np.clip(world.torso[2, 2], -1.0, 1.0)))


def contacts_of_sole(perceiver: Perceiver, stamp: float, values: Array) -> list[Contact]:
    """Shows a perceiver of icub-whole one frame of its right sole, and returns the contacts on it."""
    robot = ROBOTS["icub-whole"]
    still = JointReading(stamp, 0, np.array(initial_position(robot)), np.zeros(len(robot.servos)))
    frame = SkinFrame(SOLE, stamp, round(stamp / 0.02), values)
    return [c for c in perceiver.step(Reading(still, (frame,)), stamp).contacts if c.patch == SOLE]


def poke_the_shin(world: World, reflex: BodyWithdrawal, part: str) -> tuple[set[str], str]:
    """Pokes the shin of a leg for a second. Returns the parts that the reflex commanded, and the reason if
    the leg must not move."""
    robot = world.robot
    body = GenericBody(robot)
    place = body.landmark(part, SHIN)
    world.finger.poke(place.patch, place.p_L, place.n_L, depth=0.006)
    moved: set[str] = set()
    why = ""
    memory = reflex.init(body)

    def see(tick: Tick) -> None:
        nonlocal why, memory
        moved.update(command.part for command in tick.commands if hasattr(command, "part"))
        memory = reflex.step(memory, tick.perception, body)[1]
        if refusal := memory.refused.get(part):
            why = refusal.reason

    run(SimulatedDriver(robot, world=world), reflex, duration=1.0, observe=see)
    assert world.finger.first_contact is not None
    return moved, why


@NAMES
def test_the_soles_feel_the_weight_where_the_physics_has_it(name: str) -> None:
    world = standing(name)
    link = SimulatedDriver(world.robot, world=world)
    reading = link.read()
    contacts = Perceiver(GenericBody(world.robot)).step(reading, world.time).contacts
    total, moment = 0.0, np.zeros(3)
    for patch in ("left_sole", "right_sole"):
        own = [contact for contact in contacts if contact.patch == patch]
        force = sum(contact.force for contact in own)
        centre = np.sum([contact.force * contact.p_T for contact in own], axis=0) / force
        truth = world.contact_truth(patch)
        off = centre - truth.center
        off -= (off @ truth.normal) * truth.normal
        print(f"{name} {patch}: {force:.1f} N, centre of pressure {np.linalg.norm(off) * 1e3:.2f} mm off")
        assert force == pytest.approx(truth.force, rel=0.02)
        assert np.linalg.norm(off) <= 0.002
        total, moment = total + force, moment + force * centre
    mass = float(world.model.body_subtreemass[1])
    assert total == pytest.approx(mass * 9.81, rel=0.02)
    # At rest the centre of pressure is vertically below the centre of mass.
    off = moment / total - Gravity(world.robot).centre_of_mass(reading.joints.position)
    off = world.torso[:3, :3] @ off
    assert np.linalg.norm(off[:2]) <= 0.005


@NAMES
def test_a_poked_sole_knows_where(name: str) -> None:
    robot = ROBOTS[name]
    world = World(robot, skin=["left_sole"])
    surface = world.surfaces["left_sole"]
    random = np.random.default_rng(1)
    for _ in range(6):
        corners = surface.faces[random.integers(len(surface.faces))]
        point = random.dirichlet(np.ones(3)) @ surface.positions[corners]
        world.reset()
        world.finger.poke("left_sole", point, surface.normals[corners].mean(axis=0))
        world.advance(0.3)
        (contact,) = (
            Perceiver(GenericBody(robot))
            .step(SimulatedDriver(robot, world=world).read(), world.time)
            .contacts
        )
        truth = world.contact_truth("left_sole")
        off: Array = contact.p_T - truth.center
        off -= (off @ truth.normal) * truth.normal
        assert np.linalg.norm(off) <= 0.0015
        assert contact.force == pytest.approx(truth.force, rel=0.03)


@NAMES
def test_a_leg_that_the_robot_stands_on_stays(name: str) -> None:
    """The leg does not withdraw even if the capability's `stance` is supported, because the soles measure the
    robot's weight."""
    world = standing(name)
    moved, why = poke_the_shin(world, BodyWithdrawal(stance="supported"), "left_leg")
    assert not moved
    assert "the sole of left_leg measures" in why
    assert "left_leg carries the robot" in why
    assert np.rad2deg(tilt(world)) < 5.0


@NAMES
def test_a_leg_of_a_robot_that_hangs_answers_when_that_is_said(name: str) -> None:
    moved, why = poke_the_shin(World(ROBOTS[name]), BodyWithdrawal(stance="supported"), "left_leg")
    assert moved == {"left_leg"}
    assert not why
    moved, why = poke_the_shin(World(ROBOTS[name]), BodyWithdrawal(), "left_leg")
    assert not moved
    assert "a leg moves only if stance is 'supported'" in why


@NAMES
def test_a_leg_without_weight_answers_while_the_other_one_carries(name: str) -> None:
    world = standing(name, lean=np.deg2rad(LEAN[name]))
    knee = generic_posture(world.robot, world.joints())["left_leg"][3]
    moved, why = poke_the_shin(world, BodyWithdrawal(), "left_leg")
    assert moved == {"left_leg"}, why
    assert generic_posture(world.robot, world.joints())["left_leg"][3] > knee + np.deg2rad(15.0)
    assert np.rad2deg(tilt(world)) < 5.0
    moved, why = poke_the_shin(standing(name, lean=np.deg2rad(LEAN[name])), BodyWithdrawal(), "right_leg")
    assert not moved
    assert "the sole of right_leg measures" in why


def test_where_the_centre_of_mass_would_be_is_told() -> None:
    """The left foot of the NAO carries little weight, but the centre of mass is not over the right foot.
    Without the left foot the robot would fall."""
    world = standing("nao-whole", lean=np.deg2rad(11.0))
    reading = SimulatedDriver(world.robot, world=world).read()
    body = GenericBody(world.robot)
    perception = Perceiver(body).step(reading, world.time)
    posture = generic_posture(world.robot, reading.joints)["left_leg"]
    support = body.support(perception, "left_leg", posture)
    assert support.forces["right_leg"] > 2.0 * support.forces["left_leg"] > 0.0
    assert -0.01 < support.margin < 0.01
    moved, why = poke_the_shin(world, BodyWithdrawal(), "left_leg")
    assert not moved
    assert "centre of mass would be" in why
    assert "valid: 10 mm inside" in why


def test_a_robot_without_soles_can_not_stand() -> None:
    with pytest.raises(CommandError, match="can't stand: no skin on a segment 'foot'"):
        World(load_robot("nao"), stands=True)


def test_a_sole_that_stands_is_one_contact_and_one_in_the_air_tells_touches_apart() -> None:
    """The floor presses heel, toe and two taxels between them: 40 counts are 1.5 N on each taxel."""
    robot = ROBOTS["icub-whole"]
    body = GenericBody(robot)
    surface, rest = body.skin.surfaces[SOLE], robot.patch(SOLE).sensor.rest
    along = surface.positions[:, 0]
    order = surface.channels[np.argsort(along)]
    values = np.full(robot.patch(SOLE).channels, rest)
    strays = [order[110], order[140]]
    for counts, pressed, told in (
        (40.0, [*order[:20], *strays, *order[-5:]], [25, 27]),  # what is pressed alone waits for 0.2 s
        (6.0, [*order[:60], *order[-60:]], [120, 120]),
        (40.0, [*order[:3], *order[-3:]], [3, 3]),  # 9 N: two hands on a foot that hangs
    ):
        perceiver = Perceiver(body)
        values[:] = rest
        values[pressed] -= counts
        first, *_, last = (contacts_of_sole(perceiver, 0.02 * k, values) for k in range(15))
        touches = [*first, *last] if len(first) == 1 else last
        assert [len(contact.taxels) for contact in touches] == told
        assert all((np.diff(contact.taxels) > 0).all() for contact in touches)
        if len(last) == 1:
            assert first[0].identity == last[0].identity
            here = np.isin(surface.channels, pressed)
            np.testing.assert_allclose(last[0].p_L[0], along[here].mean(), atol=1e-3)


@pytest.mark.parametrize("number", ["01", "08"])
def test_a_real_icubs_sole_is_one_contact_while_it_stands(number: str, genuine_data: SkinData) -> None:
    """From its first frame on, while what rests beside the described 240 counts is not known yet."""
    log = np.loadtxt(genuine_data.file(f"recordings/icub_right_foot_raw_{number}.log"))
    perceiver = Perceiver(GenericBody(ROBOTS["icub-whole"]))
    stood = 0
    for row in log:
        contacts = contacts_of_sole(perceiver, float(row[1] - log[0, 1]), row[2:])
        if sum(contact.force for contact in contacts) >= 20.0:
            stood += 1
            assert len(contacts) == 1
    assert stood > 0.9 * len(log)
