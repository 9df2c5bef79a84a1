"""Which contact is which: an identity that lasts from the frame in which a contact began to its end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.errors import TciError
from tci.frames import Array
from tci.skin.isolated import LoneTaxels
from tci.skin.kernels.whole import TRACK, follow_all


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """When two contacts in successive frames of a patch are the same. Ours."""

    reach: float = 0.03
    """How far [m] the centre of a contact may go from one frame to the next."""
    linger: float = 0.1
    """How long [s] a contact may be away and still be the same when it returns."""

    def __post_init__(self) -> None:
        for name in ("reach", "linger"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise TciError(f"track settings: {name} {getattr(self, name)}; valid: 0 or more, finite")


class Tracker:
    """Gives contacts their identity. One lives as long as the skin that it follows."""

    def __init__(self, settings: TrackSettings | None = None) -> None:
        self.settings = settings or TrackSettings()
        self._tracks = np.zeros((0, TRACK))
        self._next = 1
        self.lone = LoneTaxels()
        """Taxels that are pressed alone."""

    def follow(self, patches: NDArray[np.int64], centres: Array, stamps: Array) -> Array:
        """Identity, begin [s] and distance [m] from its beginning (c, 3), of each contact of a frame.

        `patches` (c,) are the places of their patches among all, rising; `centres` (c, 3) [m] where they
        press, in the patch's link; `stamps` (p,) [s] when each patch was measured. The nearest pairs of
        before and now are the same contact, as far as `reach`; what is left over is new.
        """
        tracks, told = np.empty((len(self._tracks) + len(centres), TRACK)), np.empty((len(centres), 3))
        self._next, used = follow_all(
            self._tracks, centres, patches, stamps, self.settings.reach, self.settings.linger, self._next,
            tracks, told,
        )  # fmt: skip
        self._tracks = tracks[:used]
        return told
