"""What an arm bears by its measured torques: the second witness of a push, also on links without skin.

What it bears slowly, such as its weight, counts as its own, and dry friction is taken off. The place of a
push is unknown, but not needed: the arm gives way in its joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tci.body import GenericBody
from tci.messages import Perception
from tci.messages.frames import Array, read_only

FRICTION = 0.1
"""Fraction of a joint's torque limit that tells nothing: dry friction of 5 % that turned."""
SETTLES, FORGETS = 0.5, 2.0
"""Time constants [s] with which an arm takes what it bears for its own: while nothing pushes, and while
something seems to, as a weight that it took up would."""
EVEN = 0.03
"""Change of a speed [rad/s] within the delay, the arm's own or what it is told, above which torques tell of
its own motion (a heavy arm has them before it is fast): what they tell then is its own, unless something
pushes it already. After `SETTLES` of it, as with noisy speeds, they tell whether it still does."""


@dataclass(frozen=True, slots=True, eq=False)
class Load:
    """What one arm bears."""

    own: Array
    """Torques (n,) [N m] of its generic joints that are its own."""
    more: Array
    """What it bears beyond them (n,) [N m], along the way into whoever pushes it."""
    seen: tuple[tuple[float, Array, Array], ...]
    """Time [s], speeds (2, n) [rad/s] that it had and was told, and torques (n,) [N m] within the delay:
    single ones tell nothing."""
    uneven: float = np.inf
    """Since when its speed changes [s]; inf while it does not."""


def bear(
    load: Load | None,
    perception: Perception,
    body: GenericBody,
    part: str,
    told: Array | None,
    *,
    delay: float,
    elapsed: float,
) -> Load | None:
    """What a part bears after this instant; None if its torques are not measured.

    Args:
        load: before.
        perception: what is felt now.
        body: the robot's body.
        part: generic part.
        told: speeds (n,) [rad/s] that it was told last, if any.
        delay: from a force to the motion that answers it [s].
        elapsed: since the instant before [s].
    """
    effort = body.effort(perception, part)
    if effort is None:
        return None
    rate, now = body.rate(perception, part), perception.stamp
    rates = read_only(np.array([rate, np.zeros(len(rate)) if told is None else told]))
    if load is None:
        return Load(effort, read_only(np.zeros(effort.shape)), ((now, rates, effort),))
    seen = (*(one for one in load.seen if now - one[0] <= delay), (now, rates, effort))
    effort = read_only(np.mean([one[2] for one in seen], axis=0))
    changes = max(float(np.abs(rates - one[1]).max()) for one in seen) > EVEN
    uneven = min(load.uneven, now) if changes else np.inf
    if changes and not load.more.any():
        return replace(load, own=effort, seen=seen, uneven=uneven)
    if changes and now - uneven <= SETTLES:
        return replace(load, seen=seen, uneven=uneven)
    beyond = effort - load.own
    more = np.sign(beyond) * np.maximum(np.abs(beyond) - _friction(body, part), 0.0)
    share = 1.0 - np.exp(-elapsed / (FORGETS if more.any() else SETTLES))
    return Load(read_only(load.own + share * beyond), read_only(more), seen, uneven)


def _friction(body: GenericBody, part: str) -> Array:
    """Torques (n,) [N m] of the generic joints that tell nothing; infinite where no limit is known."""
    servos = [one.servo for one in body.robot.part(part).servos]
    limits = [None if servo is None else body.robot.servos[servo].limits.torque for servo in servos]
    return FRICTION * np.array([np.inf if one is None else one for one in limits])
