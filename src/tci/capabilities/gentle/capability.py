"""A limb on its way gives way to a person: what it presses with has a cap, and then it goes on.

Admittance per contact (Hogan 1985): into what touches it, a point of the skin moves with at most
(cap - force) / D, so it goes away above the cap and on below. D = 2 k T keeps the loop stable, with the delay
T of skin, bus and servo; k is the stiffness of the one who is met, learnt from how force rises with the arm's
own way while the arm is not slower than before, and lowered while the force does not fall although the arm
goes away: then the other one moves. A force that rises by more than the arm was told to make of it tells the
same at once; from then on what changes with time by itself is not taken for stiffness.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple

import numpy as np

from tci.body import GenericBody
from tci.body.generic_body import slowed
from tci.capabilities.capability import Capability, Memory
from tci.capabilities.gentle.load import Load, bear
from tci.capabilities.limbs import limbs
from tci.capabilities.needs import Need
from tci.capabilities.sway import Sway
from tci.capabilities.wrapper import CapabilityWrapper
from tci.errors import CommandError, TciError
from tci.messages import (
    Command,
    ExpectContact,
    GenericCommand,
    Mode,
    Order,
    Perception,
    SwitchMode,
)
from tci.messages.frames import Array, read_only

SOFT, STIFF = 4e2, 75e3
"""Stiffness [N/m] of people: of a hand that follows, so that it feels 40 N s/m, with which arms of 20 to
43 ms are calm on its pad, and of a hand that is clamped (ISO/TS 15066)."""
BODY = 10e3
"""Stiffness [N/m] of the softest part of a person who stands, the abdomen."""
HAND = 2e3
"""Stiffness [N/m] of a hand that comes, before more is known of it: that of a firm pad. If it is stiffer, the
arm goes away too far, and feels that."""
STOPS = 0.7
"""Fraction of the rise of force in one delay that is left in the next one while an arm comes to rest.
Assumed: a stopping arm has less, a hand that comes has all of it."""
WINDOW = 0.2
"""Time [s] from whose frames the stiffness is learnt."""
LEAST_WAY = 1.5e-4
"""Way [m] below which a rise of force says nothing of stiffness: encoders are no finer."""
LEARNT = 2.0
"""Time [s] after a contact for which its stiffness is known: whoever was met is still there."""
STUBBORN = 0.08
"""Time [s] above the cap after which a force that doesn't fall means that the other one follows."""
FOLLOWS = 1.0
"""Rise of force [N] within the delay, while the arm goes away, that only somebody who follows it makes."""
SHARE = 0.3
"""Share of cap / (k T) with which it comes back to somebody whom it knows."""
EXPECTED = 65.0
"""Force [N] up to which it handles contact itself: a first blow on something stiff is above the cap until the
arm has given way."""
HASTE = 0.08
"""Time [s] from whose frames the speed of somebody who comes is taken. Assumed: a few frames of a slow skin;
with half of it noise moves the arm, with double of it a hand is noticed late."""
FASTEST = 0.4
"""Speed [m/s] of a hand up to which the arm goes along. Assumed: people who come faster strike."""
LEVER = 0.08
"""Least lever [m] of a push: joints say little of one that is nearer to the axes."""
GAIN = 4.0
"""Speed per distance from the target [1/s]."""


class Push(NamedTuple):
    """A force on an arm."""

    force: float
    """[N]"""
    into: Array
    """Speed (n,) [m/rad] into who pushes for each joint's speed."""
    frame: int
    """Number of the frame that tells it."""
    on_skin: bool = True
    """Whether skin feels it."""


@dataclass(frozen=True, slots=True, eq=False)
class Partner:
    """Whom an arm met."""

    stiffness: float
    """[N/m]; 0 before it is known."""
    felt: float
    """When it was last felt [s]."""
    over: float
    """Since when the force is above the cap [s]; inf while it is not."""
    frame: int
    """Number of the frame that told it."""
    way: float
    """How far the arm has gone into it [m]."""
    coming: float
    """Speed [m/s] with which it comes nearer by itself."""
    comes: bool
    """It came nearer when the arm did not: somebody moves."""
    told: float
    """How far the arm was told to go into it [m]; ways away don't count."""
    frames: tuple[tuple[float, float, float, float], ...]
    """Time [s], force [N], way [m] and what it was told [m] of the last frames."""

    def rises(self, delay: float) -> float:
        """By how much the force has grown within the delay [N]."""
        times, forces = np.array(self.frames)[:, :2].T
        return float(forces[-1] - np.interp(times[-1] - delay, times, forces))


@dataclass(frozen=True, slots=True, eq=False)
class GentleMemory(Generic[Memory]):
    """Memory of `Gentle`."""

    inner: Memory
    stamp: float = np.nan
    """[s]"""
    targets: Mapping[str, GenericCommand] = field(default_factory=dict)
    """Where the capability wants each arm."""
    met: Mapping[str, Partner] = field(default_factory=dict)
    """Whom each arm met, by its name."""
    rates: Mapping[str, Array] = field(default_factory=dict)
    """Speeds (n,) [rad/s] that each arm was told last."""
    loads: Mapping[str, Load | None] = field(default_factory=dict)
    """What each arm bears."""
    said: tuple[str, ...] = ()


@dataclass(frozen=True)
class Gentle(CapabilityWrapper[GentleMemory[Memory]], Generic[Memory]):
    """Runs a capability that moves limbs in position mode, and lets them give way to whoever they meet: arms,
    and the fingers of a hand that no arm carries.

    They move in velocity mode, slowly, since a limb can't be gentle with what it has struck. It declares
    the contact that it handles (`ExpectContact`), so the gate answers only above that. Raises TciError for a
    setting out of range.
    """

    inner: Capability[Memory]
    """What moves the arms."""
    cap: float = 10.0
    """Force [N] with which an arm presses at most, once it has given way: 5 for a handshake, 10 for a hug, 15
    for help to stand up (arXiv 2511.04679)."""
    speed: float = 0.05
    """Speed [m/s] of the hand that nobody touches. A blow is that of the speed and of the stiffness that is
    met: at double of it, 75 N/mm are struck with 60 to 440 N."""
    delay: float = 0.05
    """Time [s] from a force to the motion that answers it: a frame of skin at 50 Hz, a reading, a servo."""
    parts: Sequence[str] = ()
    """Names of the limbs that give way; all of them if empty."""

    def __post_init__(self) -> None:
        for name, least, most in (("cap", 1.0, 30.0), ("speed", 1e-3, 1.0), ("delay", 5e-3, 0.5)):
            if not least <= getattr(self, name) <= most:
                raise TciError(f"gentle: {name} {getattr(self, name)}; valid: {least:g} to {most:g}")
        object.__setattr__(self, "parts", tuple(self.parts))

    @property
    def needs(self) -> tuple[Need, ...]:
        own = tuple(self.parts)
        if not own:
            return (*super().needs, Need("skin on an arm or on fingers", ("arm", "fingers")))
        return (*super().needs, Need(f"skin on {' or '.join(own)}", own))

    def inner_memory(self, memory: GentleMemory[Memory]) -> Memory:
        return memory.inner

    def with_inner_memory(self, memory: GentleMemory[Memory], inner: Memory) -> GentleMemory[Memory]:
        return replace(memory, inner=inner)

    def init(self, body: GenericBody) -> GentleMemory[Memory]:
        return GentleMemory(self.inner.init(body))

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """The capability's own first orders, and the switch of the arms to velocity mode."""
        arms = self._limbs(body)
        first = [one for one in super().begin(perception, body) if getattr(one, "part", "") not in arms]
        return (*first, *(SwitchMode(part, Mode.VELOCITY) for part in arms))

    def step(
        self, memory: GentleMemory[Memory], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], GentleMemory[Memory]]:
        """Raises CommandError if the capability commands an arm in another way than by positions."""
        given, memory = super().step(memory, perception, body)
        targets, orders, own = dict(memory.targets), list[Order](), self._limbs(body)
        for order in given:
            if not isinstance(order, Command):
                raise CommandError("gentle: a command in the robot's own joints; valid: to generic parts")
            if order.part not in own:
                orders.append(order)
            elif isinstance(order, GenericCommand) and order.mode is Mode.POSITION:
                targets[order.part] = order
            else:
                raise CommandError(
                    f"gentle: {order.part} is commanded in another way than by positions; valid: position"
                )
        elapsed = max(perception.stamp - memory.stamp, 0.0) if memory.stamp == memory.stamp else 0.0
        met, rates, loads, said = dict(memory.met), dict(memory.rates), dict(memory.loads), []
        for part, target in targets.items():
            loads[part] = bear(
                loads.get(part), perception, body, part, rates.get(part), delay=self.delay, elapsed=elapsed
            )
            pushes = _pushes(part, loads[part], perception, body)
            after = self._meet(met.get(part), pushes, part, rates.get(part), elapsed, perception, body)
            if after is not None:
                met[part] = after
            move, expect = self._move(part, target, pushes, after, perception, body)
            orders += [move, expect]
            rates[part] = move.values
            pressed = max((one.force for one in pushes), default=0.0)
            if pressed > 0.5 * self.cap:
                said.append(
                    f"{part} gives way: {pressed:.0f} N are on it, and it presses with {self.cap:g} N"
                )
        memory = replace(
            memory,
            stamp=perception.stamp,
            targets=targets,
            met=met,
            rates=rates,
            loads=loads,
            said=tuple(said),
        )
        return tuple(orders), memory

    def claims(self, memory: GentleMemory[Memory]) -> frozenset[str]:
        """What the capability claims, and the arms that it has moved."""
        return super().claims(memory) | frozenset(memory.targets)

    def notes(self, memory: GentleMemory[Memory]) -> tuple[str, ...]:
        return (*super().notes(memory), *memory.said)

    def _limbs(self, body: GenericBody) -> tuple[str, ...]:
        known = limbs(body)
        return tuple(part for part in known if part in self.parts) if self.parts else known

    def _meet(
        self, met: Partner | None, own: list[Push], part: str, rates: Array | None, elapsed: float,
        perception: Perception, body: GenericBody,
    ) -> Partner | None:  # fmt: skip
        """What is known of whom the arm meets, after this instant."""
        now = perception.stamp
        if not own:
            return met
        force = np.array([one.force for one in own])
        into = force @ np.array([one.into for one in own]) / float(force.sum())
        rate = float(into @ body.rate(perception, part))
        if met is None or now - met.felt > LEARNT:
            met = Partner(0.0, now, np.inf, -1, 0.0, 0.0, False, 0.0, ())
        way, frames = met.way + rate * elapsed, met.frames
        told_way = met.told + (0.0 if rates is None else max(float(into @ rates), 0.0) * elapsed)
        if now - met.felt > self.delay:
            frames = ()
        frame = max(one.frame for one in own)
        if frame == met.frame:
            return replace(met, felt=now, way=way, told=told_way)
        total = float(force.sum())
        if not frames:  # it touched since the frame before; who was stiff may be a hand that comes
            known = min(met.stiffness, HAND) if met.comes else met.stiffness
            met = replace(met, stiffness=known if known <= HAND else 0.0)
            frames = ((now - 0.01, 0.0, way - max(rate, 1e-3) * 0.01, told_way),)
        frames = (*(one for one in frames if now - one[0] <= WINDOW), (now, total, way, told_way))
        over = min(met.over, now) if total > self.cap else np.inf
        table = np.array(frames)
        stiffness = met.stiffness
        if now - table[0, 0] >= 2.0 * self.delay:  # before, the arm is still coming to rest
            stiffness = max(stiffness, _followed(table) if met.comes else _pressed(table))
        before = table[table[:, 0] <= now - self.delay]
        if len(before) and before[-1, 2] - way > LEAST_WAY and total > before[-1, 1] + FOLLOWS:
            stiffness = 0.5 * met.stiffness
        elif len(before) and now - over > STUBBORN and total > 0.9 * before[-1, 1]:
            stiffness = max(0.8 * stiffness, min(stiffness, BODY))
        if met.stiffness == 0.0:
            stiffness = _first_guess(table, self.delay)
        comes = _comes(table, self.delay)
        if comes:
            stiffness = min(stiffness, HAND)
        if not any(one.on_skin for one in own):  # joints tell no stiffness; their friction would make it high
            stiffness = min(stiffness or HAND, HAND)
        stiffness = float(np.clip(stiffness, SOFT, STIFF)) if stiffness else 0.0
        recent = table[now - table[:, 0] <= HASTE]
        coming = _coming(recent, stiffness or STIFF)
        return Partner(stiffness, now, over, frame, way, coming, comes or met.comes, told_way, frames)

    def _move(
        self, part: str, target: GenericCommand, own: list[Push], met: Partner | None,
        perception: Perception, body: GenericBody,
    ) -> tuple[GenericCommand, ExpectContact]:  # fmt: skip
        """Towards the target as far as the cap permits, or away."""
        known = met is not None and perception.stamp - met.felt < LEARNT
        speed, damping = self.speed, np.inf
        if known and met is not None:
            stiffness = met.stiffness or STIFF
            damping = 2.0 * stiffness * self.delay
            speed = min(speed, SHARE * self.cap / (stiffness * self.delay))
        want = GAIN * (target.values - perception.posture[part])
        lengths = sum(one.length for one in body.robot.part(part).segments) or 0.5
        want *= min(1.0, speed / max(float(np.abs(want).sum()) * lengths, 1e-9))
        if own:
            coming = met.coming if met is not None else 0.0
            most = [(self.cap - one.force) / damping - coming for one in own]
            stiff = met is not None and met.stiffness > HAND and met.rises(self.delay) > FOLLOWS
            if stiff or (met is not None and met.stiffness == 0.0):
                # it stands, so what rises is not of its making
                most = [min(one, 0.0) for one in most]
            want = slowed(want, np.array([one.into for one in own]), most)
        return (
            GenericCommand(part, Mode.VELOCITY, read_only(want), target.speed),
            ExpectContact(part, EXPECTED),
        )


def _pushes(part: str, load: Load | None, perception: Perception, body: GenericBody) -> list[Push]:
    """What pushes a part: as its skin feels it and, where this is more or skin feels nothing, as its joints
    bear it."""
    found = [
        Push(one.force, body.jacobian(perception, one).T @ one.n_T, one.sequence)
        for one in perception.contacts
        if one.part == part and one.patch in body.carried(part)
    ]
    if load is None or not load.more.any():
        return found
    if not found:
        lever = 0.5 * sum(one.length for one in body.robot.part(part).segments) or 0.25
        force = float(np.linalg.norm(load.more)) / lever
        return [Push(force, read_only(load.more / force), round(1e6 * perception.stamp), on_skin=False)]
    strongest = max(range(len(found)), key=lambda k: found[k].force)
    into = found[strongest].into
    borne = float(load.more @ into) / max(float(into @ into), LEVER**2)
    if borne > found[strongest].force:
        found[strongest] = found[strongest]._replace(force=borne)
    return found


def _first_guess(frames: Array, delay: float) -> float:
    """Stiffness [N/m] after two delays of first frames (n, 4), in which the arm comes to rest; 0 before.

    A force that goes on to rise, no slower than while the arm came to rest, is that of a hand that comes.
    """
    begin, now = frames[0, 0], frames[-1, 0]
    if now - begin < 2.0 * delay:
        return 0.0
    first, second, third = np.interp([now - 2.0 * delay, now - delay, now], frames[:, 0], frames[:, 1])
    return HAND if third - second > max(FOLLOWS, STOPS * (second - first)) else STIFF


def _pressed(frames: Array) -> float:
    """Stiffness [N/m] of somebody who stands, from how the force of frames (n, 4) rose with the arm's way; 0
    where that way says nothing."""
    rises, ways = frames[-1, 1] - frames[:-1, 1], frames[-1, 2] - frames[:-1, 2]
    # a stiff one stops the arm, but so does a soft one who comes: what a slower arm feels tells neither
    pace = np.abs(np.diff(frames[:, 2]) / np.maximum(np.diff(frames[:, 0]), 1e-6)).max(initial=0.0)
    told = np.abs(ways) > np.maximum(LEAST_WAY, 0.5 * pace * (frames[-1, 0] - frames[:-1, 0]))
    return float((rises[told] / ways[told]).max(initial=0.0))


def _followed(frames: Array) -> float:
    """The same of somebody who comes: what changes with time by itself is taken off both."""
    times = frames[:, 0] - frames[:, 0].mean()
    spread = float(times @ times)
    if len(frames) < 4 or spread <= 0.0:
        return 0.0
    force, way = (one - one.mean() - times * (times @ one) / spread for one in frames[:, 1:3].T)
    square = float(way @ way)
    return float(force @ way) / square if square > len(frames) * LEAST_WAY**2 else 0.0


def _comes(frames: Array, delay: float) -> bool:
    """True if the force of frames (n, 4) rises by more within a delay than the arm made: somebody comes.

    What the arm makes is what it was told to go in two delays, into somebody stiff; before two delays are
    over it is still coming to rest.
    """
    begin, now = frames[0, 0], frames[-1, 0]
    if now - begin < 2.0 * delay:
        return False
    before, half, there = np.interp(now - np.array([1.0, 0.5, 0.0]) * delay, frames[:, 0], frames[:, 1])
    made = STIFF * (frames[-1, 3] - np.interp(now - 2.0 * delay, frames[:, 0], frames[:, 3]))
    # a contact that passes from patch to patch jumps
    return bool(min(there - half, half - before) > 0.5 * (FOLLOWS + made))


def _coming(frames: Array, stiffness: float) -> float:
    """Speed [m/s] with which somebody of a known stiffness comes nearer: the slope of where its surface is,
    force / stiffness - way, over some frames (n, 4)."""
    times, place = frames[:, 0] - frames[-1, 0], frames[:, 1] / stiffness - frames[:, 2]
    if len(frames) < 3:
        return 0.0
    times = times - times.mean()
    return float(np.clip(times @ place / (times @ times), 0.0, FASTEST))


GENTLE_SWAY = Gentle(Sway())
"""All limbs sway, and give way to whoever they meet: `tci run gentle nao --touch "push 'left forearm'"`."""
