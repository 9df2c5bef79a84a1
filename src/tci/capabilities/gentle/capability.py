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
from typing import Generic

import numpy as np

from tci.body import GenericBody
from tci.body.generic_body import slowed
from tci.capabilities.capability import Capability, Memory
from tci.capabilities.gentle.load import Load, bear
from tci.capabilities.gentle.partner import FOLLOWS, HAND, LEARNT, STIFF, Partner, meet
from tci.capabilities.gentle.push import Push, pushes_on
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

SHARE = 0.3
"""Share of cap / (k T) with which it comes back to somebody whom it knows."""
EXPECTED = 65.0
"""Force [N] up to which it handles contact itself: a first blow on something stiff is above the cap until the
arm has given way."""
GAIN = 4.0
"""Speed per distance from the target [1/s]."""


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
        parts = tuple(self.parts) or ("arm", "fingers")
        where = " or ".join(self.parts) or "an arm or on fingers"
        return (*super().needs, Need(f"skin that measures force on {where}", parts, switches=False))

    def inner_memory(self, memory: GentleMemory[Memory]) -> Memory:
        return memory.inner

    def with_inner_memory(self, memory: GentleMemory[Memory], inner: Memory) -> GentleMemory[Memory]:
        return replace(memory, inner=inner)

    def init(self, body: GenericBody) -> GentleMemory[Memory]:
        """Raises UnknownNameError for a part that the robot lacks."""
        for part in self.parts:
            body.robot.part(part)
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
            pushes = pushes_on(part, loads[part], perception, body)
            if pushes:
                met[part] = meet(
                    met.get(part), pushes, perception.stamp, moves=body.rate(perception, part),
                    told=rates.get(part), elapsed=elapsed, cap=self.cap, delay=self.delay,
                )  # fmt: skip
            move, expect = self._move(part, target, pushes, met.get(part), perception, body)
            orders += [move, expect]
            rates[part] = move.values
            pressed = max((one.force for one in pushes), default=0.0)
            whom = met.get(part)
            if pushes and whom is not None and whom.holds(self.cap, self.delay):
                said.append(
                    f"{part} can't give way there: {pressed:.0f} N are on it; a joint's limit, the robot's "
                    "own body or the gate keeps it"
                )
            elif pressed > 0.5 * self.cap:
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
        if target.speed is not None:  # but it gives way as fast as it can
            want *= min(1.0, float(np.min(target.speed / np.maximum(np.abs(want), 1e-9))))
        if own:
            coming = met.coming if met is not None else 0.0
            most = [(self.cap - one.force) / damping - coming for one in own]
            stiff = met is not None and met.stiffness > HAND and met.rises(self.delay) > FOLLOWS
            if stiff or (met is not None and met.stiffness == 0.0):
                # it stands, so what rises is not of its making
                most = [min(one, 0.0) for one in most]
            want = slowed(want, np.array([one.into for one in own]), most)
        return (
            GenericCommand(part, Mode.VELOCITY, read_only(want)),
            ExpectContact(part, EXPECTED),
        )


GENTLE_SWAY = Gentle(Sway())
"""All limbs sway, and give way to whoever they meet: `tci run gentle nao --touch "push 'left forearm'"`."""
