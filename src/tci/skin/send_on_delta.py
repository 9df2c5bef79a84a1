"""Event-driven skin (send-on-delta): only changed frames are sent, and the receiver repeats the last frame.

The sensor of a patch makes frames at a constant rate and gives each a sequence number. The sender omits
frames that equal the previous frame. But every `keep_alive` seconds the sender sends one frame in any case,
so that the receiver can distinguish an unchanged patch from a dead patch. For omitted frames the receiver
passes on the array object of the last frame, and `Conditioner` only counts such frames. The perceptions equal
those of a skin that sends every frame, bit for bit, if sums of stamps and periods have no rounding errors.
With rounding errors, an estimation window can end one frame earlier or later.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.errors import TciError
from tci.messages import SkinFrame
from tci.robot.description import Robot

_EARLY = 1e-6
"""Fraction of a period by which a frame may arrive before its expected time: a tolerance for rounding errors
of the frame's stamp."""


class SendOnDelta:
    """Sender's side: selects the frames that must be sent."""

    def __init__(self, keep_alive: float) -> None:
        """Sets `keep_alive` [s], the time after which an unchanged frame is sent anyway. Raises TciError
        unless `keep_alive` is above 0 and finite."""
        self._keep_alive = check_keep_alive(keep_alive)
        self._sent: dict[str, SkinFrame] = {}

    def select(self, frames: Iterable[SkinFrame]) -> tuple[SkinFrame, ...]:
        """Returns the `frames` that must be sent.

        A frame must be sent if it differs from the last sent frame of its patch, or if `keep_alive` [s] have
        passed since that frame.
        """
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
    """Receiver's side: stores the latest frame of each patch.

    This frame is repeated in place of frames that were not sent.
    """

    def __init__(self, robot: Robot, keep_alive: float) -> None:
        """Starts without stored frames. Raises TciError unless `keep_alive` [s] is above 0 and finite."""
        self._keep_alive = check_keep_alive(keep_alive)
        self._periods = {patch.name: 1.0 / patch.rate for patch in robot.patches}
        # received frame, filled-in frame, period [s]
        self._known: dict[str, tuple[SkinFrame, SkinFrame, float]] = {}
        self._before = self._known

    def fill(self, arrived: Iterable[SkinFrame], now: float) -> tuple[SkinFrame, ...]:
        """Returns the frames at `now` [s] that a sender at constant rate would have sent.

        `arrived` are the frames received since the last call. A patch that sent nothing for `keep_alive` plus
        one period counts as dead: its last frame is no longer repeated.
        """
        self._before = self._known
        known = self._known = {**self._known}
        keep_alive, frames = self._keep_alive, []
        for frame in arrived:
            patch = frame.patch
            held, filled, period = known.get(patch) or (frame, frame, self._periods.get(patch))
            if period is None:  # conditioning reports an unknown patch
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

    def undo(self) -> None:
        """Undoes the last call of `fill`.

        Call this method if the frames of that call were refused, so that none of these frames is repeated.
        """
        self._known = self._before


def check_keep_alive(seconds: float) -> float:
    """Returns `seconds`. Raises TciError unless `seconds` is above 0 and finite."""
    if not 0.0 < seconds < np.inf:
        raise TciError(f"keep-alive of {seconds} s; valid: above 0 and finite")
    return seconds
