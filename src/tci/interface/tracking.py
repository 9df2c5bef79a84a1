"""Which contact is which: an identity that lasts from the frame in which a contact began to its end."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tci.errors import TciError
from tci.frames import Array


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


@dataclass(slots=True)
class _Track:
    identity: int
    began: float
    origin: tuple[float, ...]
    seen: float
    p_L: tuple[float, ...]


class Tracker:
    """Gives contacts their identity. One lives as long as the skin that it follows."""

    def __init__(self, settings: TrackSettings | None = None) -> None:
        self.settings = settings or TrackSettings()
        self._tracks: dict[str, list[_Track]] = {}
        self._next = 1

    def follow(self, patch: str, centres: Array, stamp: float) -> list[tuple[int, float, float]]:
        """Identity, begin [s] and distance [m] from its beginning, of each contact of a frame at `stamp` [s].

        `centres` (c, 3) [m] are where they press, in the patch's link. The nearest pairs of before and
        now are the same contact, as far as `reach`; what is left over is new.
        """
        old = [one for one in self._tracks.get(patch, ()) if stamp - one.seen <= self.settings.linger]
        found: list[_Track | None] = [None] * len(centres)
        # A patch has few contacts: plain numbers are quicker than arrays of so few.
        places = [tuple(centre) for centre in centres.tolist()]
        pairs = [
            (apart, now, before)
            for now, centre in enumerate(places)
            for before, one in enumerate(old)
            if (apart := math.dist(centre, one.p_L)) <= self.settings.reach
        ]
        taken: set[int] = set()
        for _, now, before in sorted(pairs):
            if found[now] is None and before not in taken:
                found[now] = old[before]
                taken.add(before)
        for now, centre in enumerate(places):
            track = found[now]
            if track is None:
                track = found[now] = _Track(self._next, stamp, centre, stamp, centre)
                old.append(track)
                self._next += 1
            track.seen, track.p_L = stamp, centre
        self._tracks[patch] = old
        return [
            (track.identity, track.began, math.dist(track.p_L, track.origin))
            for track in found
            if track is not None
        ]
