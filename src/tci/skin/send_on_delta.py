"""Event-driven skin: senders send what changed, and the interface sees what a clocked sender would have sent.

A patch's sensor still counts its frames at its own rate; the sender leaves out those that equal the one
before, but for one every `keep_alive` seconds, which tells an unchanged patch from a dead one. A frame that
was left out costs nothing but counting: `Conditioner` knows it by its values being the same object. What is
perceived is the same to the bit where times of frames are exact numbers; elsewhere a rounded sum of times can
make the baseline's next lesson one frame sooner or later.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.errors import TciError
from tci.messages import SkinFrame
from tci.robot.description import Robot

_EARLY = 1e-6
"""Share of a period that a frame may be early by rounding."""


class SendOnDelta:
    """The sender's side: which frames to send."""

    def __init__(self, keep_alive: float) -> None:
        """Raises TciError unless `keep_alive` [s] is above 0 and finite."""
        self._keep_alive = check_keep_alive(keep_alive)
        self._sent: dict[str, SkinFrame] = {}

    def select(self, frames: Iterable[SkinFrame]) -> tuple[SkinFrame, ...]:
        """Those of the `frames` that differ from what was sent of their patch last, or are due anyway."""
        return tuple(frame for frame in frames if self._is_due(frame))

    def _is_due(self, frame: SkinFrame) -> bool:
        last = self._sent.get(frame.patch)
        if last is not None:
            if frame.sequence == last.sequence:
                return False
            waited = frame.stamp - last.stamp
            if waited < self._keep_alive and np.array_equal(frame.values, last.values):
                return False
        self._sent[frame.patch] = frame
        return True


class HoldLast:
    """The receiver's side: the latest frame of every patch, with those that were left out."""

    def __init__(self, robot: Robot, keep_alive: float) -> None:
        """Raises TciError unless `keep_alive` [s] is above 0 and finite."""
        self._keep_alive = check_keep_alive(keep_alive)
        self._periods = {patch.name: 1.0 / patch.rate for patch in robot.patches}
        self._known: dict[str, tuple[SkinFrame, SkinFrame, float]] = {}  # what came, the latest, its period

    def fill(self, arrived: Iterable[SkinFrame], now: float) -> tuple[SkinFrame, ...]:
        """What a clocked sender's latest frames were at `now` [s], from those that `arrived` until now.

        A patch that sent nothing for `keep_alive` and one period more is dead: its last frame stays.
        """
        known, keep_alive, frames = self._known, self._keep_alive, []
        for frame in arrived:
            patch = frame.patch
            held, filled, period = known.get(patch) or (frame, frame, self._periods.get(patch))
            if period is None:  # the skin says what is wrong with it
                frames.append(frame)
                continue
            if held is not frame and (held.sequence != frame.sequence or held.stamp != frame.stamp):
                held = filled = frame
            age = now - held.stamp
            left_out = int((keep_alive if age > keep_alive else age) / period + _EARLY)
            if held.sequence + left_out > filled.sequence:
                stamp = held.stamp + left_out * period
                filled = SkinFrame(patch, stamp, held.sequence + left_out, held.values)
            known[patch] = held, filled, period
            frames.append(filled)
        return tuple(frames)


def check_keep_alive(seconds: float) -> float:
    """The same. Raises TciError unless it is above 0 and finite."""
    if not 0.0 < seconds < np.inf:
        raise TciError(f"keep-alive of {seconds} s; valid: above 0 and finite")
    return seconds
