"""A hand that touches where, and as firmly, as somebody says from moment to moment: with the mouse."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tci.errors import CommandError
from tci.messages.frames import Array
from tci.simulation.hand import Hand
from tci.simulation.hand_control import MOMENT
from tci.simulation.hand_model import PAD_DAMPING, PAD_MASS
from tci.simulation.hand_path import APPROACH, BEHIND, GAP, PADS, RISE, HandPath
from tci.simulation.touch import FRICTION

COMES = 0.3
"""Length [s] of the press with which a live touch begins, until the first `update` that steers it."""
AHEAD = 0.3
"""Time [s] for which the hand knows what to do. Without an `update` for so long it goes away."""
PACE = 2.0 * np.pi * 3.0
"""[rad/s] Place and force follow what is aimed at as a person's do: critically damped, at 3 Hz."""
_FAR = 0.03
"""Largest distance [m] between the skin that was seen and its collision shape. Assumed."""
_TIP = "index"
_SOON = 0.02
"""Time [s] after which the surface is looked for under the finger. Assumed: two periods."""


class LiveTouch:
    """One finger tip of a hand. Call `update` once in every period, in the thread that steps the world."""

    def __init__(self, hand: Hand, link: str, point: ArrayLike, normal: ArrayLike, force: float) -> None:
        """Begins at `point` (3,) [m] with the outward `normal` (3,), in the link's frame, with `force` [N].
        Raises the errors of `Hand.touch`."""
        self.hand, self._physics = hand, hand.physics
        self._aimed = self._started = _checked(point, normal, force)
        now = np.array([self._aimed[:6]] * 2)
        path = HandPath(
            link=link, times=[0.0, COMES], points=now[:, :3], normals=now[:, 3:], forces=[[force]] * 2,
            pads=(_TIP,),
        )  # fmt: skip
        hand.touch(path)
        self._link = path.link
        self._took_over = hand.physics.steps + round((APPROACH + RISE) / self._physics.step)
        self._state = np.zeros((2, 7))  # place, normal and force that are asked now, and their rates
        self._height = 0.0
        self._turn = hand.turn(self._link, self._aimed[3:6])
        self._seen = self._took_over
        self._leaving = self._left = False

    @property
    def busy(self) -> bool:
        """False when the hand has gone away."""
        return self.hand.busy

    @property
    def asked(self) -> float:
        """Force [N] that the hand tries to press with now."""
        return self.hand.asked

    def aim(self, point: ArrayLike, normal: ArrayLike, force: float) -> None:
        """Where to go along the skin, as at the start, and how firmly to press there."""
        self._aimed = _checked(point, normal, force)

    def leave(self) -> None:
        """Lifts the hand, which then goes away."""
        self._leaving = True

    def update(self) -> None:
        """Plans the next moments."""
        steps = self._physics.steps
        if not self.busy or self._left or steps < self._took_over:
            return
        if not self._state.any():
            self._state[0] = self._started
            self._height = self.hand.height(self._link, _TIP, self._state[0, :3], self._state[0, 3:6])
        else:
            self._state = _follow(self._state, self._aimed, (steps - self._seen) * self._physics.step)
        self._seen = steps
        self._left = self._leaving
        self._plan()

    def _plan(self) -> None:
        step = self._physics.step
        times = step * np.arange(1, round((RISE + APPROACH if self._left else AHEAD) / step) + 1)
        moves = _follow(self._state, self._state[0] if self._left else self._aimed, times)
        rows, normals, force = moves[:, 0], moves[:, 0, 3:6], np.maximum(moves[:, 0, 6], 0.0)
        normals = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        after = rows[min(len(rows), round(_SOON / step)) - 1]
        high = self.hand.height(self._link, _TIP, after[:3], after[3:6])
        high = float(np.clip(high, self._height - _FAR, self._height + _FAR))
        share = np.minimum(times / _SOON, 1.0)
        height = self._height + (high - self._height) * share
        self._height = high
        turn, before = self.hand.turn(self._link, after[3:6]), self._turn
        turn = turn if turn @ before >= 0.0 else -turn
        turns = before + (turn - before) * share[:, None]
        self._turn = turn
        lifted = np.zeros_like(times)
        if self._left:
            force = force * np.cos(0.5 * np.pi * np.minimum(times / RISE, 1.0))
            s = np.clip((times - RISE) / APPROACH, 0.0, 1.0)
            lifted = 2.0 * GAP * s**2 * (3.0 - 2.0 * s)
        person = self.hand.person
        depth = force / person.pad - lifted
        place = rows[:, :3] + (height - depth)[:, None] * normals
        speed = np.linalg.norm(moves[:, 1, :3], axis=1, keepdims=True)
        drag = FRICTION * force[:, None] * moves[:, 1, :3] / (speed + 5e-3)
        pressed = person.pad * depth + 2.0 * PAD_DAMPING * np.sqrt(person.pad * PAD_MASS) * np.gradient(
            depth, step
        )
        plan = np.zeros(len(times), MOMENT)
        plan["base"], plan["asked"] = place, force
        plan["push"] = drag - np.where(depth > 0.0, pressed, 0.0)[:, None] * normals
        for number, name in enumerate(PADS):
            plan["place"][:, number] = place + (0.0 if name == _TIP else BEHIND) * normals
            plan["normal"][:, number] = normals
            plan["turn"][:, number] = turns / np.linalg.norm(turns, axis=1, keepdims=True)
            plan["share"][:, number] = float(name == _TIP)
        self.hand.replan(plan)


def _follow(state: Array, aimed: Array, times: ArrayLike) -> Array:
    """State (2, m) or (n, 2, m) after `times` (n,) [s] on the way to `aimed` (m,), without overshoot."""
    t = np.asarray(times)[..., None]
    off, rate = state[0] - aimed, state[1] + PACE * (state[0] - aimed)
    faded = np.exp(-PACE * t)
    return np.stack([aimed + (off + rate * t) * faded, (rate - PACE * (off + rate * t)) * faded], axis=-2)


def _checked(point: ArrayLike, normal: ArrayLike, force: float) -> Array:
    """Point, unit normal and force as one vector (7,)."""
    p, n = np.asarray(point, dtype=float), np.asarray(normal, dtype=float)
    size = float(np.linalg.norm(n))
    if p.shape != (3,) or n.shape != (3,) or not np.isfinite([*p, *n]).all() or not size > 0.0:
        raise CommandError("a place of a live touch; valid: a point (3,) and a normal (3,), finite")
    if not 0.0 < force < np.inf:
        raise CommandError(f"force {force} N of a live touch; valid: above 0 N, finite")
    return np.array([*p, *(n / size), force])
