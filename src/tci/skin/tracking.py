"""Identities of contacts. An identity stays constant from the first frame of a contact to its last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tci.errors import TciError
from tci.messages.frames import Array
from tci.skin.kernels.arrays import ContactArrays, room_for
from tci.skin.kernels.track import MATCH, TRACK, track


@dataclass(frozen=True, slots=True)
class TrackSettings:
    """Conditions under which contacts in successive frames of a patch count as one contact.

    All figures are assumed.
    """

    reach: float = 0.03
    """Largest distance [m] by which the centre of a contact may move between two frames. With a larger value,
    separate touches are joined. With a smaller value, a fast slide is split."""
    linger: float = 0.1
    """Longest time [s] for which a contact may disappear without losing its identity."""

    def __post_init__(self) -> None:
        for name in ("reach", "linger"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise TciError(f"track settings: {name} {getattr(self, name)}; valid: 0 or more, finite")


class Tracker:
    """Assigns identities to contacts. Contains the tracks of one skin."""

    def __init__(self, settings: TrackSettings = TrackSettings()) -> None:
        self.settings = settings
        self._tracks = np.zeros(0, TRACK)
        self._next = 1

    def follow(self, contacts: ContactArrays, stamps: Array) -> None:
        """Writes identity, onset and displacement of the contacts of a frame.

        `stamps` (p,) [s] are the times of the patches' frames. Each contact is matched with a track of the
        frame before, at a distance of at most `reach`; the nearest pairs are matched first. Contacts without
        a match are new.
        """
        tracks = room_for(len(self._tracks) + len(contacts.rows), TRACK)
        best = room_for(len(contacts.rows), MATCH)
        self._next, used = track(
            self._tracks,
            stamps,
            self.settings.reach,
            self.settings.linger,
            self._next,
            tracks,
            best,
            contacts,
        )
        self._tracks = tracks[:used]
