"""The contact stop: a touched part stops immediately, and continues after the touch."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from helpers.touches import BODY, POSTURE, see, touch
from tci.body.generic_body import GenericBody
from tci.body.places import find_place
from tci.capabilities.capability import Capability
from tci.capabilities.contact_stop import ContactStop
from tci.capabilities.fields import default_fields
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.messages import CartesianCommand, Command, GenericCommand, Mode, Perception, SwitchMode
from tci.messages.frames import read_only
from tci.robot.catalogue import load_robot
from tci.runtime.loop import run
from tci.simulation.world import World
from tci.skin.skin import Skin

TARGET = read_only(POSTURE + 0.3)


@dataclass(frozen=True)
class Raise(Capability[bool]):
    """Moves one arm: sends a single command in position mode, and a command in each step in the other
    modes."""

    mode: Mode = Mode.POSITION
    target: tuple[float, ...] = tuple(TARGET)

    def init(self, body: GenericBody) -> bool:
        return False

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        return () if self.mode is Mode.POSITION else (SwitchMode("left_arm", self.mode),)

    def step(
        self, memory: bool, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], bool]:
        if memory and self.mode is Mode.POSITION:
            return (), True
        return (GenericCommand("left_arm", self.mode, read_only(self.target)),), True


def play(behaviour: ContactStop[bool], *moments: Perception) -> list[tuple[Command, ...]]:
    memory, all_commands = behaviour.init(BODY), []
    for moment in moments:
        commands, memory = behaviour.step(memory, moment, BODY)
        all_commands.append(commands)
    return all_commands


TOUCH = touch(0.5, 0.0, [3.0])


def test_without_touch_the_behaviour_is_unchanged() -> None:
    first, second = play(ContactStop(Raise()), see(), see(stamp=0.01))
    assert [c.values.tolist() for c in first if isinstance(c, GenericCommand)] == [TARGET.tolist()]
    assert second == ()


def test_a_touch_stops_the_part_once_and_its_end_sends_it_on() -> None:
    sent = play(
        ContactStop(Raise(), quiet=0.1),
        see(),
        see(TOUCH, stamp=0.1),
        see(TOUCH, stamp=0.2),
        see(stamp=0.25),
        see(stamp=0.31),
        see(stamp=0.32),
    )
    values = [[c.values.tolist() for c in commands if isinstance(c, GenericCommand)] for commands in sent]
    assert values == [[TARGET.tolist()], [POSTURE.tolist()], [], [], [TARGET.tolist()], []]


def test_the_other_arm_goes_on() -> None:
    other = touch(0.5, 0.0, [3.0], part="right_arm")
    assert play(ContactStop(Raise()), see(), see(other, stamp=0.1))[1] == ()


def test_a_weak_touch_does_not_stop() -> None:
    weak = touch(0.5, 0.0, [0.5])
    assert play(ContactStop(Raise()), see(), see(weak, stamp=0.1))[1] == ()


@pytest.mark.parametrize("mode", [Mode.VELOCITY, Mode.TORQUE])
def test_in_velocity_and_torque_mode_it_sends_zero(mode: Mode) -> None:
    sent = play(ContactStop(Raise(mode)), see(), see(TOUCH, stamp=0.1), see(TOUCH, stamp=0.11))
    assert [c.values.tolist() for c in sent[1] if isinstance(c, GenericCommand)] == [[0.0] * 5]
    assert sent[2] == ()


@dataclass(frozen=True)
class Reach(Capability[bool]):
    """Moves a hand to a position, with a single command or a command in each step."""

    always: bool

    def init(self, body: GenericBody) -> bool:
        return False

    def step(
        self, memory: bool, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], bool]:
        place = CartesianCommand("left_arm", read_only([0.5, 0.0, -0.5]))
        return ((place,) if self.always or not memory else ()), True


@pytest.mark.parametrize("always", [True, False])
def test_a_hand_on_its_way_stops_and_goes_on(always: bool) -> None:
    moments = (see(), see(TOUCH, stamp=0.1), see(TOUCH, stamp=0.2), see(stamp=0.25), see(stamp=0.31))
    first, stop, *still, on = play(ContactStop(Reach(always), quiet=0.1), *moments)
    assert [type(command) for command in first] == [CartesianCommand]
    (held,) = stop
    assert isinstance(held, GenericCommand)
    assert held.mode is Mode.POSITION
    assert held.values.tolist() == POSTURE.tolist()
    assert still == [(), ()]
    (again,) = on
    assert isinstance(again, CartesianCommand)
    assert again.target.tolist() == [0.5, 0.0, -0.5]


def peak_force(name: str, *, stops: bool) -> float:
    """Bends an elbow towards a fixed finger, and returns the largest contact force [N]."""
    world = World(load_robot(name))
    link = SimulatedDriver(world.robot, world=world)
    field = next(field for field in default_fields() if field.name == "forearm_flexor")
    place = find_place(Skin(world.robot), "left_arm", field.segment, field.u, field.theta, link.read().joints)
    world.finger.poke(place.patch, place.p_L, place.n_L, speed=1e-4, depth=0.0, gap=0.004)
    bend = Raise(Mode.VELOCITY, target=(0.0, 0.0, 0.0, 0.5, 0.0))
    if stops:
        run(link, ContactStop(bend), duration=0.6)
    else:
        run(link, bend, duration=0.6)
    return world.finger.peak_force


@pytest.mark.parametrize("name", ["nao", "icub"])
def test_an_arm_that_runs_into_a_finger_stops(name: str) -> None:
    stopped, pushing = peak_force(name, stops=True), peak_force(name, stops=False)
    print(f"{name}: {stopped:.1f} N with the stop, {pushing:.1f} N without")
    assert 0.5 < stopped < 0.4 * pushing


@pytest.mark.parametrize("name", ["threshold", "quiet"])
def test_settings_are_checked(name: str) -> None:
    with pytest.raises(TciError, match=f"contact stop: {name} 0"):
        ContactStop(Raise(), **{name: 0.0})
