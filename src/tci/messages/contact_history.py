"""The contacts of the last seconds, for what takes time to feel: a tap, a stroke, a hand that stays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tci.errors import TciError
from tci.messages.contacts import Contacts, Frozen, Records, Site
from tci.messages.frames import Array
from tci.messages.perception import Perception


@dataclass(frozen=True, slots=True, eq=False)
class ContactPath(Frozen):
    """One contact over time, from its oldest frame in a history to its newest."""

    identity: int
    """Its number, see `Contact.identity`."""
    site: Site
    """Names of patch, part and segment."""
    onset: float
    """Time [s] of its first frame, also if that is older than the history."""
    ended: bool
    """True if the newest frame no longer has it."""
    stamp: Array
    """Times (k,) [s] of the frames."""
    rows: Records
    """The contact in each of these frames: records (k,) of `Contact`'s numbers and vectors, for example
    `path.rows["area"]`."""

    @property
    def duration(self) -> float:
        """Time [s] from the onset to the newest frame with the contact."""
        return float(self.stamp[-1]) - self.onset

    @property
    def force(self) -> Array:
        """Force (k,) [N]."""
        return self.rows["force"]

    @property
    def p_L(self) -> Array:
        """Path (k, 3) [m] of the centre of pressure, in the frame of the patch's link: where it moved over
        the skin."""
        return self.rows["p_L"]

    @property
    def p_T(self) -> Array:
        """Path (k, 3) [m] of the centre of pressure, in the torso frame."""
        return self.rows["p_T"]

    @property
    def u(self) -> Array:
        """Positions (k,) along the limb's segment, 0 to 1; NaN if the patch is not on a limb."""
        return self.rows["u"]

    @property
    def theta(self) -> Array:
        """Angles (k,) [rad] around the limb's segment; NaN if the patch is not on a limb."""
        return self.rows["theta"]


@dataclass(frozen=True, slots=True, eq=False)
class ContactHistory:
    """The frames with contacts of the last seconds. A value, for the memory of a capability::

        history = history.add(perception)

    It shares the frames and copies nothing. Raises TciError for a setting out of range.
    """

    span: float = 2.0
    """Time [s] for which frames are kept. Assumed: longer than a tap, a stroke or a pat."""
    capacity: int = 1000
    """Largest number of frames that are kept. Assumed: enough for `span` at 500 frames/s."""
    frames: tuple[Contacts, ...] = ()
    """The frames, the oldest first."""
    times: tuple[float, ...] = ()
    """Time [s] at which each frame was first perceived."""
    newest: Contacts | None = None
    """The newest frame; None before the first."""

    def __post_init__(self) -> None:
        if not 0.0 < self.span < np.inf:
            raise TciError(f"contact history: span {self.span} s; valid: above 0, finite")
        if self.capacity < 1:
            raise TciError(f"contact history: capacity {self.capacity}; valid: 1 or more")

    def add(self, perception: Perception) -> ContactHistory:
        """The history with this perception's frame. A frame that is the newest already changes nothing. If
        the time went back, it begins anew."""
        frame, now = perception.contacts, perception.stamp
        newest = self.newest
        if newest is not None and (frame is newest or _same(frame, newest)):
            return self
        frames, times = self.frames, self.times
        if times and now < times[-1]:
            frames, times = (), ()
        if len(frame):
            frames, times = (*frames, frame), (*times, now)
        first = max(len(frames) - self.capacity, 0)
        while first < len(frames) and times[first] < now - self.span:
            first += 1
        return replace(self, frames=frames[first:], times=times[first:], newest=frame)

    @property
    def identities(self) -> tuple[int, ...]:
        """Identities of all contacts in the history, in the order of their onset."""
        onsets: dict[int, float] = {}
        for frame in self.frames:
            for identity, onset in zip(frame.identity.tolist(), frame.onset.tolist(), strict=True):
                onsets.setdefault(identity, onset)
        return tuple(sorted(onsets, key=lambda identity: (onsets[identity], identity)))

    @property
    def paths(self) -> tuple[ContactPath, ...]:
        """All contacts over time, in the order of their onset."""
        return tuple(self.path(identity) for identity in self.identities)

    @property
    def ended(self) -> tuple[ContactPath, ...]:
        """The contacts that have ended."""
        return tuple(path for path in self.paths if path.ended)

    def path(self, identity: int) -> ContactPath:
        """One contact over time, with one row per frame of its patch. Raises TciError if the history has no
        such contact."""
        found: dict[float, tuple[Contacts, int]] = {}
        for frame in self.frames:
            for row in np.flatnonzero(frame.identity == identity).tolist():
                # the frame of another patch repeats this one
                found.setdefault(float(frame.stamp[frame.site[row]]), (frame, row))
        if not found:
            known = ", ".join(map(str, self.identities)) or "none yet"
            raise TciError(f"no contact {identity} in the history; valid: {known}")
        frame, row = next(iter(found.values()))
        return ContactPath(
            identity=identity,
            site=frame.sites[frame.site[row]],
            onset=float(frame.onset[row]),
            ended=self.newest is None or identity not in self.newest.identity,
            stamp=np.array([*found]),
            rows=np.stack([one.rows[place] for one, place in found.values()]),
        )


def _same(frame: Contacts, other: Contacts) -> bool:
    """True if both are made of the same frames of all patches."""
    return (frame.sites, frame.sequence.tobytes(), frame.stamp.tobytes()) == (
        other.sites, other.sequence.tobytes(), other.stamp.tobytes()
    )  # fmt: skip
