"""Taxels that are pressed all alone: light touches, or taxels that are broken.

A touch is as wide as the cover over the taxels makes it, and what touches is wide itself, the wider the
harder it presses. Where taxels are near, their neighbours feel it too; a taxel alone beside sound ones that
feel nothing is broken, or pressed so lightly that only time tells.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array
from tci.skin.kernels.flat_skin import FlatSkin
from tci.skin.kernels.isolated import WAITING, leave_out

_EARLY = 1e-6
"""Time [s] that a frame may be early by rounding."""
_NONE = np.zeros(0, np.int64)
_NOBODY: Array = np.zeros((0, WAITING))


@dataclass(frozen=True, slots=True)
class LoneSettings:
    """When a taxel that is pressed all alone is a touch. All figures are ours.

    Under a force F on one taxel, with area A, a neighbour at the distance d feels at least the share
    exp(-d^2 / 2 s^2) of its pressure, s^2 = cover^2 + A / 12 + (tip F^(1/3))^2 / 4: the variances, along one
    side, of what the cover makes of a point, of a square taxel, and of a round contact, whose radius grows
    with the cube root of the force (Hertz 1882). Where a neighbour should feel `sure` times what it would
    notice, the lone taxel is broken. Where it need not, or where all neighbours are on one side, the taxel is
    a touch once it was pressed for `wait` (and has changed meanwhile, if noise lets no taxel like it stay the
    same), and until then if it is what is left of a touch, or if another taxel within twice the `reach` is
    pressed: one touch, over a gap in the skin. One with fewer than two believed neighbours within
    `reach` is always a touch.
    """

    cover: float = 3e-3
    """Width [m] of the Gaussian that the cover over the taxels makes of a point."""
    tip: float = 3e-3
    """Radius [m] of the contact at 1 N: a blunt pencil. A fingertip's is 4 to 5 mm."""
    reach: float = 0.015
    """Distance [m] up to which a neighbour can be expected to feel the same touch."""
    sure: float = 2.0
    """How many times what a neighbour notices it must be expected to feel."""
    wait: float = 0.2
    """How long [s] a light touch may be one of a single taxel that is not believed yet."""
    frames: int = 10
    """And at least so many frames: noise passes a threshold in one, not in many at a stretch."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < np.inf:
                raise TciError(f"lone taxels: {field.name} {value}; valid: above 0 and finite")


class LoneTaxels:
    """What must be known of one frame of a skin in the next."""

    def __init__(self) -> None:
        self.nobody_waits()
        self.remember()

    def nobody_waits(self) -> None:
        """No taxel is pressed alone."""
        self._waiting = _NOBODY

    def remember(
        self,
        bounds: NDArray[np.int64] = _NONE,
        patches: NDArray[np.int64] = _NONE,
        indices: NDArray[np.int64] = _NONE,
    ) -> None:
        """The contacts of a frame, see `ContactTable`; without arguments: none."""
        self._contacts = bounds, patches, indices

    def leave_out(
        self,
        flat: FlatSkin,
        force: Array,
        least: Array,
        lively: NDArray[np.bool_],
        stamps: Array,
        lone: int,
        waits: bool,
        *,
        floor: float,
        settings: LoneSettings,
    ) -> tuple[int, int]:
        """Of the contacts in the skin's memory, `lone` of them with a single taxel, leave those that are
        touches; their number, and that of their taxels.

        `force` (n,) [N] on each taxel and `least` (n,) [Pa] that it notices, `lively` (n,) where
        noise never lets a value stay the same; `stamps` (p,) [s] of the frames;
        `waits`: whether light ones wait.
        """
        wait = np.maximum(settings.wait, settings.frames / flat.rates) - _EARLY if waits else 0.0 * flat.rates
        limits = np.array([settings.cover, settings.tip, settings.reach, settings.sure])
        fresh = np.empty((lone, WAITING))
        count, taxels, waiting = leave_out(
            force, least, lively, flat.taxels, flat.graph, flat.begins, floor, limits, wait, stamps,
            *self._contacts, self._waiting, flat.work, flat.counts, fresh,
        )  # fmt: skip
        self._waiting = fresh[:waiting]
        return count, taxels
