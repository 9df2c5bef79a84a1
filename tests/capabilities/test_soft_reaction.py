"""The soft reaction: a pushed arm yields, on both robots. Also tests the Jacobian that the reaction uses."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.touches import BOTH_ARMS, away, body_that, see, touch
from tci.body.generic_body import GenericBody
from tci.body.posture import to_platform
from tci.capabilities.fields import default_fields
from tci.capabilities.soft_reaction import SoftReaction
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, TciError
from tci.lab.experiments.poke import Stimulus, Trace, poke
from tci.messages import Contact, GenericCommand, Mode
from tci.messages.frames import Array, apply, read_only
from tci.robot.catalogue import load_robot
from tci.runtime.loop import Tick, run
from tci.simulation.world import World

SITE = next(field for field in default_fields() if field.name == "forearm_extensor")
SLOW = Stimulus(speed=0.05, depth=0.02, duration=0.8)
JACOBIAN = np.array([[0.1, 0.0, 0.0, 0.2, 0.0], [0.0, 0.3, 0.0, 0.0, 0.0], [0.0, 0.0, 0.1, 0.0, 0.0]])
BODY = body_that(retreat=away, jacobian=lambda perception, contact: JACOBIAN)


def seen(*contacts: Contact, stamp: float = 0.0, posture: Array | None = None):
    arms = BOTH_ARMS if posture is None else {**BOTH_ARMS, "left_arm": posture}
    return see(*contacts, stamp=stamp, posture=arms), BODY


def values(commands: object, part: str = "left_arm") -> Array:
    (found,) = [c.values for c in commands if c.part == part]
    return found


def test_velocity_is_the_transposed_jacobian_times_the_force() -> None:
    reaction = SoftReaction(mobility=2.0)
    commands, _ = reaction.step({}, *seen(touch(0.5, 0.0, [4.0])))
    np.testing.assert_allclose(values(commands), 2.0 * JACOBIAN.T @ [-4.0, 0.0, 0.0])
    assert not values(commands, "right_arm").any()


def test_forces_of_several_contacts_add_up_and_weak_ones_do_not_count() -> None:
    reaction = SoftReaction(threshold=1.0)
    one, _ = reaction.step({}, *seen(touch(0.5, 0.0, [4.0])))
    three, _ = reaction.step({}, *seen(*[touch(0.5, 0.0, [force]) for force in (4.0, 4.0, 0.9)]))
    np.testing.assert_allclose(values(three), 2.0 * values(one))


def test_torque_mode_holds_where_the_last_touch_left_the_arm() -> None:
    reaction = SoftReaction(mode=Mode.TORQUE, stiffness=5.0, damping=0.0)
    bent = read_only(BOTH_ARMS["left_arm"] + 0.2)
    _, memory = reaction.step({}, *seen(touch(0.5, 0.0, [4.0]), posture=bent))
    commands, _ = reaction.step(memory, *seen(stamp=0.01, posture=read_only(bent - 0.1)))
    np.testing.assert_allclose(values(commands), 0.5)


@pytest.mark.parametrize(("across", "yields"), [(0.09, True), (0.11, False)])
def test_a_motion_along_the_skin_is_no_yielding(across: float, yields: bool) -> None:
    """In an earlier version a wrist turned about the finger that touched its palm, and the contact force
    increased by 0.0025 N."""

    def retreat(perception: object, part: str, target: Array, mode: Mode, *, driven: bool) -> Array:
        return np.array([[[0.0001], [0.02]], [[across / 200.0], [across]], [[0.0], [0.0]]])

    perception = see(touch(0.5, 0.0, [4.0]), posture=BOTH_ARMS)
    body = body_that(retreat=retreat, jacobian=lambda perception, contact: JACOBIAN)
    commands, memory = SoftReaction().step({}, perception, body)
    assert bool(values(commands).any()) is yields
    assert ("drag left_arm_forearm" in "".join(SoftReaction().notes(memory))) is not yields


def test_torque_mode_damps() -> None:
    reaction = SoftReaction(mode=Mode.TORQUE, stiffness=0.0, damping=0.5)
    _, memory = reaction.step({}, *seen())
    moved = read_only(BOTH_ARMS["left_arm"] + 0.02)
    commands, _ = reaction.step(memory, *seen(stamp=0.01, posture=moved))
    np.testing.assert_allclose(values(commands), -0.5 * 2.0)


@pytest.mark.parametrize("name", ["nao", "icub"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_the_jacobian_of_a_contact_is_the_kinematics_own(name: str, side: str) -> None:
    world = World(load_robot(name))
    robot, part = world.robot, f"{side}_arm"
    body, contacts = GenericBody(robot), []
    link = SimulatedDriver(robot, world=world)

    def note(tick: Tick) -> None:
        contacts.extend((contact, tick) for contact in tick.perception.contacts)

    poke(world, part, SITE, Stimulus(duration=0.05), reflex=WithdrawalReflex(fields=()), seed=0, watch=note)
    contact, tick = contacts[-1]
    jacobian = body.jacobian(tick.perception, contact)
    assert jacobian.shape == (3, 5)
    posture = tick.perception.posture[part]
    points = []
    for step in 1e-6 * np.concatenate([np.eye(5), -np.eye(5)]):
        command = to_platform(robot, GenericCommand(part, Mode.POSITION, posture + step))
        position = np.array(tick.reading.joints.position)
        position[command.servos] = command.values
        T_TL = body.skin.kinematics.poses(position, [robot.patch(contact.patch).link])
        points.append(apply(T_TL[robot.patch(contact.patch).link], contact.p_L))
    differences = (np.array(points[:5]) - np.array(points[5:])).T / 2e-6
    np.testing.assert_allclose(jacobian, differences, atol=1e-7)
    link.close()


def pushed(name: str, reaction: SoftReaction | None) -> Trace:
    world = World(load_robot(name))
    if reaction is None:
        return poke(world, "left_arm", SITE, SLOW, reflex=WithdrawalReflex(fields=()), seed=0)
    return poke(world, "left_arm", SITE, SLOW, reflex=reaction, seed=0)


@pytest.mark.parametrize(
    ("name", "mode"), [("nao", Mode.VELOCITY), ("icub", Mode.VELOCITY), ("icub", Mode.TORQUE)]
)
def test_a_pushed_arm_goes_along_and_is_pressed_less(name: str, mode: Mode) -> None:
    held, soft = pushed(name, None), pushed(name, SoftReaction(mode=mode))
    moved = -(soft.point[-1] - soft.point[0]) @ soft.normal
    forces = f"{held.peak_force:.1f} N held, {soft.peak_force:.1f} N soft"
    print(f"{name} {mode.value}: {forces}, moved {1e3 * moved:.1f} mm")
    assert moved > 0.008
    assert soft.peak_force < 0.6 * held.peak_force
    assert not any(safe.reason for safe in soft.sent)


def test_a_robot_without_torque_says_so_before_anything_moves() -> None:
    world = World(load_robot("nao"))
    link = SimulatedDriver(world.robot, world=world)
    before = link.read().joints.position
    with pytest.raises(CommandError, match=r"SoftReaction can't begin: nao: .* has no torque mode; valid"):
        run(link, SoftReaction(mode=Mode.TORQUE), duration=0.1)
    np.testing.assert_array_equal(link.read().joints.position, before)


def test_settings_and_parts_are_checked() -> None:
    with pytest.raises(TciError, match="mode position; valid: velocity, torque"):
        SoftReaction(mode=Mode.POSITION)
    with pytest.raises(TciError, match="mobility -1"):
        SoftReaction(mobility=-1.0)
    with pytest.raises(
        TciError, match="soft reaction: the robot has no part 'tail'; valid: left_arm, right_arm"
    ):
        SoftReaction(parts=("tail",)).step({}, *seen())


def test_a_part_without_a_joint_is_not_commanded_and_a_touch_of_it_says_why() -> None:
    body, reaction = GenericBody(load_robot("nao-whole")), SoftReaction(parts=("torso", "left_arm"))
    posture = {**BOTH_ARMS, "torso": np.zeros(3)}
    perception = see(touch(0.5, 0.0, [4.0], part="torso"), posture=posture)
    assert [order.part for order in reaction.begin(perception, body)] == ["left_arm"]
    commands, memory = reaction.step({}, perception, body)
    assert [command.part for command in commands] == ["left_arm"]
    assert reaction.notes(memory) == ("torso was touched and does not move: it has no joint on this robot",)
