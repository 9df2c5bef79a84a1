"""A light grasp reflex: a hand closes and holds with little force if its palm is touched.

The hand opens when a finger is pulled. The reflex imitates the palmar grasp of an infant. The flexion of each
finger controls the force on this finger (integral force control, Raibert & Craig 1981). The robot needs
generic fingers with skin on palm and finger tips. If several fingers share a motor, they close until one of
them presses with enough force.

A stiff finger presses with all by which its target is ahead of it, so at its first touch it begins anew from
where it is. If it bounces off, it comes back more gently each time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.capabilities.retreat import why_not
from tci.errors import TciError
from tci.messages import Contacts, GenericCommand, Mode, Order, Perception
from tci.messages.frames import Array, read_only
from tci.robot.generic_fingers import FINGERS, FLEXIONS, PALM

LEAD = 0.1
"""Largest angle [rad] by which a finger's target may be ahead of its joint. Assumed: prevents integrator
windup if a finger is blocked."""
OPPOSES = 2.0
"""Speed of the thumb's opposition as a multiple of the speed of flexions. Assumed: then the thumb lies across
the palm before the fingers close."""
GENTLEST = 1.0 / 64.0
"""Least share of `speed` and `gain` with which a finger closes that bounces. Assumed: six bounces."""
LONGEST = 0.1
"""Longest time [s] by which one step moves the targets of the fingers on. So the hand does not jump after a
pause. Assumed: several periods of any skin."""


@dataclass(frozen=True, slots=True)
class Press:
    """What fingers that share a motor have felt since their hand closed."""

    touched: bool = False
    """True from their first touch."""
    hardest: float = 0.0
    """Largest force [N] since they last touched nothing."""
    bounces: int = 0
    """How often they lost what they had pressed with more than the setting `force`."""

    def after(self, force: float, enough: float) -> Press:
        """The state with the present `force` [N]; `enough` [N] is the setting."""
        if force > 0.0:
            return Press(True, max(self.hardest, force), self.bounces)
        return Press(self.touched, 0.0, self.bounces + (self.hardest > enough))


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """State of one hand."""

    stamp: float
    """Time [s] of the last perception."""
    flexion: Array
    """Targets (n,) [rad] of the generic joints."""
    closed: bool = False
    """True from the touch of the palm until the hand opens."""
    presses: tuple[Press, ...] = ()
    """Of each group of fingers that share a motor."""
    hardest: float = 0.0
    """Largest force [N] on a finger since the hand closed."""
    holds: bool = False
    """True if, since the hand closed, a finger has pressed with at least half of the setting `force`."""
    felt: float = -np.inf
    """Latest time [s] at which palm or fingers were touched, or at which the hand opened; -inf if there was
    no such time."""
    rested: float = -np.inf
    """Latest time [s] without a pull at a finger; the hand opens `patience` [s] later."""


Grips = Mapping[str, Grip]
"""Memory of a light grasp: the state of each hand, by name of the generic part."""


def forces_of(contacts: Contacts) -> dict[str, dict[str, float]]:
    """Force [N] on each touched segment of each touched part."""
    forces: dict[str, dict[str, float]] = {}
    for place, force in zip(contacts.site.tolist(), contacts.force.tolist(), strict=True):
        site = contacts.sites[place]
        own = forces.setdefault(site.part, {})
        own[site.segment] = own.get(site.segment, 0.0) + force
    return forces


@dataclass(frozen=True)
class LightGrasp(Capability[Grips]):
    """Closes each hand whose palm is touched. Raises TciError for a setting out of range.

    The defaults are assumed, since no values are published for these robots.
    """

    needs = (Need("skin on a palm", ("fingers",), (PALM,)),)
    force: float = 1.0
    """Force [N] with which each finger presses. Assumed: enough to measure a held object, and harmless."""
    touch: float = 0.3
    """Smallest force [N] on the palm that makes the hand close."""
    pull: float = 2.5
    """Least force [N] with which a person must pull a finger to make the hand open. The hand also opens when
    a held object leaves the palm."""
    speed: float = 0.3
    """Speed [rad/s] of the flexion until a finger presses. After one has felt n times `force`, all close
    n times slower until the hand opens. Assumed: a faster finger would press too much before its skin
    measures the contact."""
    gain: float = 0.05
    """Speed of a pressing finger, divided by the missing force [rad/s per N]. The missing force is `force`
    minus the measured force. A finger that bounces off closes with half of it, and so on; it opens with all
    of it. Assumed: with this gain, most fingers do not oscillate, although their skin reports
    a change of force about 20 ms late."""
    opposition: float = 1.2
    """Angle [rad] of the thumb across the palm while the hand is closed."""
    patience: float = 0.15
    """Shortest duration [s] of a pull that opens the hand. Assumed: longer than the impact of a finger."""
    quiet: float = 0.5
    """Time [s] without any touch after which a closed hand opens, and after which an open hand may close
    again."""
    most: float = 1.5
    """Largest flexion [rad]. A finger that touches nothing stops at this angle."""

    def __post_init__(self) -> None:
        for name in ("force", "touch", "pull", "speed", "gain", "opposition", "patience", "quiet", "most"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"light grasp: {name} {getattr(self, name)}; valid: above 0, finite")
        if not self.force < self.pull:
            raise TciError(f"light grasp: pull {self.pull}; valid: above the force of {self.force} N")

    def init(self, body: GenericBody) -> Grips:
        """All hands are open."""
        return {}

    def step(
        self, memory: Grips, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Grips]:
        """Returns a command for each hand whose target changed."""
        commands, grips = [], {}
        pressed = forces_of(perception.contacts)
        for part in body.parts("fingers"):
            rest = body.robot.part(part).initial_posture
            before = memory.get(part) or Grip(perception.stamp, rest)
            after = grips[part] = self._grip(before, perception, body, part, rest, pressed.get(part, {}))
            if after.flexion is not before.flexion:
                commands.append(GenericCommand(part, Mode.POSITION, after.flexion))
        return tuple(commands), grips

    def claims(self, memory: Grips) -> frozenset[str]:
        """The hands that are closed, or were touched or opened less than `quiet` ago."""
        return frozenset(
            part for part, grip in memory.items() if grip.closed or grip.stamp - grip.felt < self.quiet
        )

    def _grip(
        self, before: Grip, perception: Perception, body: GenericBody, part: str, rest: Array,
        pressed: Mapping[str, float],
    ) -> Grip:  # fmt: skip
        """Returns the state of a hand's grasp after `perception`. `before` is the previous state, `rest` (n,)
        [rad] is the open posture of the hand, and `pressed` are the forces [N] by its segments."""
        now = perception.stamp
        palm = pressed.get(PALM, 0.0)
        most = max((pressed[finger] for finger in FINGERS if finger in pressed), default=0.0)
        felt = now if max(palm, most) >= self.touch else before.felt
        if not before.closed:
            closes = palm >= self.touch and now - before.felt >= self.quiet
            start = perception.posture[part] if closes else before.flexion
            return Grip(now, start, closed=closes, felt=felt, rested=now)
        pulled = most >= self.pull or (before.holds and palm < self.touch <= most)
        rested = before.rested if pulled else now
        pulled_open = now - rested >= self.patience and not why_not(perception, body, part, rest)
        if pulled_open or now - felt >= self.quiet:
            return Grip(now, rest, felt=now)
        bent = [group for group in map(_flexions, body.tied(part)) if group]
        forces = [max(pressed.get(FINGERS[FLEXIONS.index(one)], 0.0) for one in group) for group in bent]
        presses = before.presses or (Press(),) * len(bent)
        grip = Grip(
            now, before.flexion, closed=True, felt=felt, rested=rested,
            presses=tuple(one.after(force, self.force) for one, force in zip(presses, forces, strict=True)),
            hardest=max(before.hardest, most), holds=before.holds or most >= 0.5 * self.force,
        )  # fmt: skip
        target, here = np.array(before.flexion), perception.posture[part]
        for group, old, new in zip(bent, presses, grip.presses, strict=True):
            if new.touched and not old.touched:
                target[group] = np.minimum(target[group], here[group])
        elapsed = min(max(now - before.stamp, 0.0), LONGEST)
        return replace(grip, flexion=self._flexion(grip, target, here, bent, forces, elapsed))

    def _flexion(
        self, grip: Grip, target: Array, here: Array, bent: Sequence[list[int]], forces: Sequence[float],
        elapsed: float,
    ) -> Array:  # fmt: skip
        """Moves the target angles (n,) [rad] of a hand that is at `here` (n,) [rad] on by `elapsed` [s], so
        that the force on each finger approaches the setting `force`. `bent` are the groups of flexions that
        share a motor, and `forces` [N] what each presses with."""
        target[0] = min(max(target[0], self.opposition), target[0] + OPPOSES * self.speed * elapsed)
        fastest = self.speed * min(self.force / max(grip.hardest, self.force), 1.0)
        for group, force, press in zip(bent, forces, grip.presses, strict=True):
            share = max(0.5**press.bounces, GENTLEST)
            rate = self.gain * (self.force - force)
            if force <= 0.0:
                rate = max(share * fastest, GENTLEST * self.speed)
            elif rate > 0.0:
                rate = share * min(rate, self.speed)
            wanted = target[group] + max(rate, -self.speed) * elapsed
            target[group] = np.clip(np.minimum(wanted, here[group] + LEAD), 0.0, self.most)
        return read_only(target)


def _flexions(group: Sequence[int]) -> list[int]:
    return [joint for joint in group if joint in FLEXIONS]
