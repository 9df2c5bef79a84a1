"""Pokes one point of the skin with the simulated finger, with or without a reflex, and records the poke."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeGuard

import numpy as np

from tci.body.places import Place, find_place
from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import SafeCommand
from tci.lab.experiments.remote_trial import RemoteTrial, Trial, part_of
from tci.messages import CONTROL_MODES, Contact, GenericCommand, Order
from tci.messages.frames import Array
from tci.runtime.loop import Tick, run
from tci.simulation.world import World
from tci.skin.skin import Skin


@dataclass(frozen=True, slots=True)
class Stimulus:
    """Motion of the finger. The default values are assumed: a firm, quick poke by a person."""

    speed: float = 0.25
    """Speed of the finger's base [m/s]."""
    depth: float = 0.010
    """Final depth [m] of the finger's base below the place where the skin's surface was at the start. The
    base never moves back."""
    gap: float = 0.004
    """Distance [m] between finger and skin at the start."""
    duration: float = 1.0
    """Length of the trial [s]."""


DEEP = Stimulus(depth=0.020)
"""A poke of 16 N, for touches that are felt through joints: half of it is often not felt there."""


@dataclass(slots=True)
class Trace:
    """Record of a poke, with one sample per control period. All times are on the simulation's clock."""

    place: Place
    """The poked point of the skin."""
    normal: Array
    """Outward unit normal (3,) of the skin at the poked point, in the torso frame, before the poke."""
    taxels: int
    """Number of taxels of the poked patch."""
    depth: float = 0.0
    """Final depth [m] of the finger's base, from the stimulus."""
    start: float = 0.0
    """Time [s] at which the finger started to move."""
    first_contact: float | None = None
    """Time [s] of the first contact, with the resolution of the simulation step. The value is None if there
    was no contact."""
    contact_lost: float | None = None
    """Time [s] of the end of the last contact. The value is None if the finger touched the skin until the end
    of the trial, or never touched the skin."""
    peak_force: float = 0.0
    """Largest contact force [N] in the physics simulation."""
    time: list[float] = field(default_factory=list)
    """Time [s] of each sample."""
    force: list[float] = field(default_factory=list)
    """Contact force [N] in the physics simulation, for each sample."""
    center: dict[float, Array] = field(default_factory=dict)
    """Mean (3,) [m], weighted by force, of the contact points in the physics simulation; the key is the time
    [s]. Coordinates are in the torso frame."""
    point: list[Array] = field(default_factory=list)
    """Position (3,) [m] of `place` in the torso frame, for each sample."""
    away: list[float] = field(default_factory=list)
    """Displacement [m] of `place` along the inward normal since the start, for each sample. The world frame
    is used, because the torso may also move."""
    positions: list[Array] = field(default_factory=list)
    """Joint angles (n_servos,) [rad] in the physics simulation, for each sample."""
    velocities: list[Array] = field(default_factory=list)
    """Joint velocities (n_servos,) [rad/s] in the physics simulation, for each sample."""
    sent: list[SafeCommand] = field(default_factory=list)
    """All commands that were sent to the robot."""
    commanded: list[tuple[float, str]] = field(default_factory=list)
    """Time [s] and generic part of each command of the reflex."""
    notes: tuple[str, ...] = ()
    """Messages of the reflex at the end of the trial. The tuple is empty if the reflex ran in another
    process."""
    contacts: dict[float, Contact] = field(default_factory=dict)
    """Strongest contact that TCI found in each skin frame, by the time [s] of the frame, as it was told
    first: frames of other patches, which may be faster, tell it again where the skin has moved to."""


def moves(command: Order) -> TypeGuard[GenericCommand]:
    """Returns True if an order moves a generic part. Orders that switch the control mode or set a stiffness
    do not move a part."""
    return isinstance(command, GenericCommand) and command.mode in CONTROL_MODES


class _Poke(Trial):
    """One poke of one point of the skin, and the trace of this poke."""

    def __init__(
        self, world: World, place: Place, stimulus: Stimulus, seed: int,
        watch: Callable[[Tick], None] | None,
    ) -> None:  # fmt: skip
        self.place = place
        _, normal = world.skin_point(place.patch, place.p_L, place.n_L)
        self._begun = world.skin_point_in_world(place.patch, place.p_L, place.n_L)
        self.trace = Trace(place, normal, len(world.surfaces[place.patch].positions), stimulus.depth)
        shift = np.random.default_rng(seed).uniform(0.0, 0.020) * stimulus.speed
        self._way = {"speed": stimulus.speed, "depth": stimulus.depth, "gap": stimulus.gap + shift}
        self._world, self._watch = world, watch

    def begin(self, now: float) -> None:
        """Starts the motion of the finger."""
        self.trace.start = now
        self._world.finger.poke(self.place.patch, self.place.p_L, self.place.n_L, **self._way)

    def see(self, tick: Tick) -> None:
        world, place, trace = self._world, self.place, self.trace
        truth = world.contact_truth(place.patch)
        trace.time.append(tick.now)
        trace.force.append(truth.force)
        if truth.force > 0.0:
            trace.center[tick.now] = truth.center
        now, normal = world.skin_point_in_world(place.patch, place.p_L, place.n_L)
        trace.point.append(world.to_torso(now, normal)[0])
        point, outward = self._begun
        trace.away.append(float(outward @ (point - now)))
        joints = world.joints()
        trace.positions.append(joints.position)
        trace.velocities.append(joints.velocity)
        trace.sent.append(tick.sent)
        for command in tick.commands:
            part = command.part if moves(command) else part_of(world.robot, command)
            if part is not None:
                trace.commanded.append((tick.now, part))
        for contact in sorted(tick.perception.contacts, key=lambda contact: -contact.force):
            trace.contacts.setdefault(contact.stamp, contact)
        if self._watch is not None:
            self._watch(tick)

    def end(self) -> Trace:
        """Returns the complete trace."""
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
    """Pokes the centre of `site` on an arm, and records the poke.

    Args:
        world: Simulation, which is reset before the poke.
        part: Generic arm.
        site: Receptive field to poke.
        stimulus: Motion of the finger.
        reflex: Capability that runs. A reflex without receptive fields only keeps the arm's posture.
        seed: Seed of a random delay, which shifts the first contact by up to 20 ms relative to the skin's
            frames.
        watch: Function that is called after each period of the loop.
        elsewhere: Other process with a reflex, which runs instead of `reflex`.

    Raises the errors of `run` and of `RemoteTrial.run`.
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
    """Resets `world`, pokes the point `place` of its skin, and records the poke. `watch` is called after each
    period of the loop, and a reflex in `elsewhere`, another process, runs instead of `reflex`. Raises the
    errors of `poke`."""
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
