"""Whom an arm met: how stiff they are, and whether they come."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tci.capabilities.gentle.push import Push
from tci.messages.frames import Array

SOFT, STIFF = 4e2, 75e3
"""Stiffness [N/m] of people: of a hand that follows, so that it feels 40 N s/m, with which arms of 20 to
43 ms are calm on its pad, and of a hand that is clamped (ISO/TS 15066)."""
BODY = 10e3
"""Stiffness [N/m] of the softest part of a person who stands, the abdomen."""
HAND = 2e3
"""Stiffness [N/m] of a hand that comes, before more is known of it: that of a firm pad. If it is stiffer, the
arm goes away too far, and feels that. How fast it comes is never told from a softer one: a hand that follows
seems soft, and an arm that left it too fast lost it, to meet it again."""
STOPS = 0.7
"""Fraction of the rise of force in one delay that is left in the next one while an arm comes to rest.
Assumed: a stopping arm has less, a hand that comes has all of it."""
WINDOW = 4.0
"""Number of delays from whose frames the stiffness is learnt. In two of them the arm comes to rest."""
LEAST_WAY = 1.5e-4
"""Way [m] below which a rise of force says nothing of stiffness: encoders are no finer."""
LEARNT = 2.0
"""Time [s] after a contact for which its stiffness is known: whoever was met is still there."""
STUBBORN = 0.08
"""Time [s] above the cap after which a force that doesn't fall means that the other one follows."""
FOLLOWS = 1.0
"""Rise of force [N] within the delay, while the arm goes away, that only somebody who follows it makes."""
HASTE = 0.08
"""Time [s] from whose frames the speed of somebody who comes is taken. Assumed: a few frames of a slow skin;
with half of it noise moves the arm, with double of it a hand is noticed late."""
FASTEST = 0.4
"""Speed [m/s] of a hand up to which the arm goes along. Assumed: people who come faster strike."""


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

    def holds(self, cap: float, delay: float) -> bool:
        """True if the arm stays where it is, although it was pressed above its cap for so long that it should
        have gone away by a way that encoders see."""
        (begin, _, start, _), (now, force, way, _) = self.frames[0], self.frames[-1]
        lasts = min(now - begin, now - self.over) >= 0.75 * WINDOW * delay
        return lasts and (force - cap) > 2.0 * LEAST_WAY * self.stiffness and start - way < LEAST_WAY


def meet(
    met: Partner | None,
    own: list[Push],
    now: float,
    *,
    moves: Array,
    told: Array | None,
    elapsed: float,
    cap: float,
    delay: float,
) -> Partner:
    """What is known of whom an arm meets, after this instant.

    Args:
        met: whom it met before; None if there was nobody.
        own: what pushes the arm, at least one.
        now: time [s].
        moves: speeds (n,) [rad/s] of its joints.
        told: those that it was told last.
        elapsed: time [s] since the instant before.
        cap: force [N] with which it presses at most.
        delay: time [s] from a force to the motion that answers it.
    """
    force = np.array([one.force for one in own])
    into = force @ np.array([one.into for one in own]) / float(force.sum())
    rate = float(into @ moves)
    if met is None or now - met.felt > LEARNT:
        met = Partner(0.0, now, np.inf, -1, 0.0, 0.0, False, 0.0, ())
    way, frames = met.way + rate * elapsed, met.frames
    told_way = met.told + (0.0 if told is None else max(float(into @ told), 0.0) * elapsed)
    if now - met.felt > delay:
        frames = ()
    frame = max(one.frame for one in own)
    if frame == met.frame:
        return replace(met, felt=now, way=way, told=told_way)
    total = float(force.sum())
    if not frames:  # it touched since the frame before; who was stiff may be a hand that comes
        known = min(met.stiffness, HAND) if met.comes else met.stiffness
        met = replace(met, stiffness=known if known <= HAND else 0.0)
        frames = ((now - 0.01, 0.0, way - max(rate, 1e-3) * 0.01, told_way),)
    frames = (*(one for one in frames if now - one[0] <= WINDOW * delay), (now, total, way, told_way))
    over = min(met.over, now) if total > cap else np.inf
    table = np.array(frames)
    stiffness = met.stiffness
    if now - table[0, 0] >= 2.0 * delay:  # before, the arm is still coming to rest
        stiffness = max(stiffness, _followed(table) if met.comes else _pressed(table))
    before = table[table[:, 0] <= now - delay]
    if len(before) and before[-1, 2] - way > LEAST_WAY and total > before[-1, 1] + FOLLOWS:
        stiffness = 0.5 * met.stiffness
    elif len(before) and now - over > STUBBORN and total > 0.9 * before[-1, 1]:
        stiffness = max(0.8 * stiffness, min(stiffness, BODY))
    if met.stiffness == 0.0:
        stiffness = _first_guess(table, delay)
    comes = _comes(table, delay)
    if comes:
        stiffness = min(stiffness, HAND)
    if not any(one.on_skin for one in own):  # joints tell no stiffness; their friction would make it high
        stiffness = min(stiffness or HAND, HAND)
    stiffness = float(np.clip(stiffness, SOFT, STIFF)) if stiffness else 0.0
    recent = table[now - table[:, 0] <= HASTE]
    coming = _coming(recent, max(stiffness, HAND) if stiffness else STIFF)
    return Partner(stiffness, now, over, frame, way, coming, comes or met.comes, told_way, frames)


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
