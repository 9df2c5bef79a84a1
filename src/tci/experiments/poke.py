"""One poke of one site, recorded: the finger comes, the reflex answers or is switched off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeGuard

import numpy as np

from tci.body.places import Place, find_place
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField
from tci.drivers.simulated import SimulatedDriver
from tci.experiments.remote_trial import RemoteTrial, Trial, part_of
from tci.frames import Array
from tci.gate.gate import SafeCommand
from tci.messages import CONTROL_MODES, Contact, GenericCommand, Order
from tci.runtime.loop import Tick, run
from tci.simulation.world import World
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True)
class Stimulus:
    """What the finger does. Speeds and depths are ours: a firm, quick poke."""

    speed: float = 0.25
    """Speed of the finger's base [m/s]."""
    depth: float = 0.010
    """How far [m] the base goes beyond the skin's place at rest; it never retreats."""
    gap: float = 0.004
    """Distance [m] between finger and skin at the start."""
    duration: float = 1.0
    """Length of the trial [s]."""


@dataclass(slots=True)
class Trace:
    """What happened, sampled once per control period on the simulation's clock."""

    place: Place
    """The poked point of the skin."""
    normal: Array
    """Outward unit normal (3,) there at the start, seen from the torso."""
    taxels: int
    """Taxels of the patch."""
    start: float = 0.0
    """When the finger left [s]."""
    first_contact: float | None = None
    """When the finger first touched [s], to the physics' step."""
    contact_lost: float | None = None
    """When it last ceased to touch [s]; None when it touched to the end."""
    peak_force: float = 0.0
    """Largest contact force of the physics [N]."""
    time: list[float] = field(default_factory=list)
    """Time of each sample [s]."""
    force: list[float] = field(default_factory=list)
    """Contact force [N] of the physics."""
    center: dict[float, Array] = field(default_factory=dict)
    """Force-weighted contact point (3,) [m] of the physics, seen from the torso, by time [s]."""
    point: list[Array] = field(default_factory=list)
    """Where `place` is (3,) [m], seen from the torso."""
    away: list[float] = field(default_factory=list)
    """How far [m] it is from where it began, along the inward normal, seen from the world: torsos move."""
    positions: list[Array] = field(default_factory=list)
    """Joint angles of the physics (n,) [rad]."""
    velocities: list[Array] = field(default_factory=list)
    """Joint velocities of the physics (n,) [rad/s]."""
    sent: list[SafeCommand] = field(default_factory=list)
    """All that was written."""
    commanded: list[tuple[float, str]] = field(default_factory=list)
    """When the reflex gave a command [s], and to which part."""
    notes: tuple[str, ...] = ()
    """What the reflex told in the end; empty where it was in another process."""
    contacts: dict[float, Contact] = field(default_factory=dict)
    """The strongest contact that TCI found, by the time of its frame [s]."""


def moves(command: Order) -> TypeGuard[GenericCommand]:
    """Whether a command moves anything: a switch of mode or a stiffness does not."""
    return isinstance(command, GenericCommand) and command.mode in CONTROL_MODES


class _Poke(Trial):
    """The finger's way to one place, and what happens."""

    def __init__(
        self, world: World, place: Place, stimulus: Stimulus, seed: int,
        watch: Callable[[Tick], None] | None,
    ) -> None:  # fmt: skip
        self.place = place
        _, normal = world.skin_point(place.patch, place.p_L, place.n_L)
        self._begun = world.skin_point_in_world(place.patch, place.p_L, place.n_L)
        self.trace = Trace(place, normal, len(world.surfaces[place.patch].positions))
        shift = np.random.default_rng(seed).uniform(0.0, 0.020) * stimulus.speed
        self._way = {"speed": stimulus.speed, "depth": stimulus.depth, "gap": stimulus.gap + shift}
        self._world, self._watch = world, watch

    def begin(self, now: float) -> None:
        """The finger leaves."""
        self.trace.start = now
        self._world.finger.poke(self.place.patch, self.place.p_L, self.place.n_L, **self._way)

    def see(self, tick: Tick) -> None:
        world, place, trace = self._world, self.place, self.trace
        truth = world.contact_truth(place.patch)
        trace.time.append(tick.now)
        trace.force.append(truth.force)
        if truth.force > 0.0:
            trace.center[tick.now] = truth.center
        trace.point.append(world.skin_point(place.patch, place.p_L, place.n_L)[0])
        point, outward = self._begun
        now = world.skin_point_in_world(place.patch, place.p_L, place.n_L)[0]
        trace.away.append(float(outward @ (point - now)))
        joints = world.joints()
        trace.positions.append(joints.position)
        trace.velocities.append(joints.velocity)
        trace.sent.append(tick.sent)
        for command in tick.commands:
            part = command.part if moves(command) else part_of(world.robot, command)
            if part is not None:
                trace.commanded.append((tick.now, part))
        for contact in sorted(tick.perception.contacts, key=lambda contact: contact.force):
            trace.contacts[contact.stamp] = contact
        if self._watch is not None:
            self._watch(tick)

    def end(self) -> Trace:
        """What happened."""
        finger = self._world.finger
        self.trace.first_contact, self.trace.contact_lost = finger.first_contact, finger.contact_lost
        self.trace.peak_force = finger.peak_force
        return self.trace


def poke(
    world: World,
    part: str,
    site: ReceptiveField,
    stimulus: Stimulus,
    *,
    reflex: Capability[Any],
    seed: int,
    watch: Callable[[Tick], None] | None = None,
    elsewhere: RemoteTrial | None = None,
) -> Trace:
    """Poke the centre of `site` on the arm `part` and record what happens.

    The world is reset first. `seed` shifts the first contact against the skin's frames, by up to
    20 ms. A `reflex` without fields only holds the arm's posture. `watch` is called after each tick.
    With `elsewhere` the reflex there answers instead. Raises what `run` and `RemoteTrial.run` raise.
    """
    world.reset()
    place = find_place(Skin(world.robot), part, site.segment, site.u, site.theta, world.joints())
    return poke_place(world, place, stimulus, reflex=reflex, seed=seed, watch=watch, elsewhere=elsewhere)


def poke_place(
    world: World,
    place: Place,
    stimulus: Stimulus,
    *,
    reflex: Capability[Any],
    seed: int,
    watch: Callable[[Tick], None] | None = None,
    elsewhere: RemoteTrial | None = None,
) -> Trace:
    """The same at any place of the skin."""
    world.reset()
    trial = _Poke(world, place, stimulus, seed, watch)
    if elsewhere is not None:
        elsewhere.run(world, stimulus.duration, trial)
        return trial.end()
    trial.begin(world.time)
    driver = SimulatedDriver(world.robot, world=world)
    result = run(driver, reflex, duration=stimulus.duration, observe=trial.see)
    trial.trace.notes = reflex.notes(result.memory)
    return trial.end()
