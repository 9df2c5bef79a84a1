"""One touch after another on each part of the body: where a touch begins, and when it is over.

A part's contacts belong to one touch until nobody has touched the part for `QUIET`: so the blows of a pat and
the passes of a stroke are one touch, and somebody who pauses longer begins another one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tci.body import GenericBody
from tci.capabilities.touch_words.features import MOMENT, moment, nothing
from tci.messages import Contact, Perception
from tci.messages.contacts import Records

QUIET = 0.46
"""Time [s] without contact after which a touch is over. People pause for 0.12 to 0.4 s between two blows;
with half of it each blow is a touch of its own, with double of it the word comes late."""
LONGEST = 12.0
"""Time [s] after which a touch is told although it lasts. Assumed: nobody means one thing for so long."""
BEFORE = 0.3
"""Time constant [s] with which the speed of the robot before a touch fades. Assumed: a bump stops an arm
before its contact is felt."""
EVERY = 0.015
"""Least time [s] between two moments: quicker skins say no more of a hand."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """A touch of one part, as far as it has come."""

    part: str
    link: str
    """Link in whose frame its centre is followed: the one that was touched first."""
    onset: float
    """[s]"""
    felt: float
    """When it was last felt [s]."""
    moments: bytes
    """Records of type `MOMENT`, one after another."""
    strongest: Contact
    """Where and when it pressed hardest."""
    own_speed: float
    """Largest speed [rad/s] with which the robot itself moved the part just before."""
    told: bool = False
    """True if it lasted so long that it has been told."""

    def rows(self) -> Records:
        """Its moments (n,), from the first to the last one in which it was felt."""
        rows = np.frombuffer(self.moments, MOMENT)
        return rows[: int(np.flatnonzero(rows["force"] > 0.0)[-1]) + 1]


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """All touches that are not over, and how the robot moves."""

    touches: Mapping[str, Track] = field(default_factory=dict)
    """By part."""
    speeds: Mapping[str, float] = field(default_factory=dict)
    """Speed [rad/s] of the fastest joint of each part; it fades within `BEFORE`."""
    stamp: float = -np.inf
    """Of the latest perception [s]."""


def follow(tracks: Tracks, perception: Perception, body: GenericBody) -> tuple[Tracks, tuple[Track, ...]]:
    """The open touches after a perception, and those that are to be told now."""
    now = perception.stamp
    if perception.joints is None or now - tracks.stamp < EVERY:
        return (tracks, ()) if now >= tracks.stamp else (Tracks(), ())
    touched: dict[str, list[Contact]] = {}
    for contact in perception.contacts:
        if len(contact.taxels):
            touched.setdefault(contact.part, []).append(contact)
    after, over = dict(tracks.touches), list[Track]()
    for part in {**tracks.touches, **touched}:
        track, contacts = tracks.touches.get(part), touched.get(part, [])
        if contacts:
            track = _felt(track, part, contacts, perception, body, tracks.speeds.get(part, 0.0))
        elif track is not None and now - track.felt > QUIET:
            del after[part]
            if not track.told:
                over.append(track)
            continue
        elif track is not None and not track.told:
            track = replace(track, moments=track.moments + nothing(now))
        if track is None:
            continue
        if not track.told and now - track.onset > LONGEST:
            over.append(track)
            track = replace(track, told=True, moments=b"")
        after[part] = track
    return Tracks(after, _speeds(tracks, perception, body), now), tuple(over)


def _speeds(tracks: Tracks, perception: Perception, body: GenericBody) -> Mapping[str, float]:
    kept = np.exp(-(perception.stamp - tracks.stamp) / BEFORE)
    return {
        part: max(
            float(np.abs(body.rate(perception, part)).max(initial=0.0)), kept * tracks.speeds.get(part, 0.0)
        )
        for part in perception.posture
    }


def _felt(
    track: Track | None, part: str, contacts: list[Contact], perception: Perception, body: GenericBody,
    own_speed: float,
) -> Track:  # fmt: skip
    now, joints = perception.stamp, perception.joints
    assert joints is not None
    strongest = max(contacts, key=lambda one: one.force)
    if track is None:
        link = body.skin.surfaces[strongest.patch].link
        return Track(part, link, now, now, moment(contacts, body, joints, now, link), strongest, own_speed)
    if track.told:
        return replace(track, felt=now)
    if strongest.force < track.strongest.force:
        strongest = track.strongest
    moments = track.moments + moment(contacts, body, joints, now, track.link)
    return replace(track, felt=now, moments=moments, strongest=strongest)
