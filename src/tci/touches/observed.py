"""Touches that were felt, as a sequence that can be written to a file and done again on any robot."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from tci.body.generic_body import GenericBody
from tci.errors import TciError
from tci.messages import Contact, LimbPlace, Perception
from tci.robot.generic_arm import SEGMENTS
from tci.touches.places import find_spot, place_words, words_of
from tci.touches.touch import DURATIONS, FORCES, SPEEDS, Touch

GAP = 0.1
"""Time [s] without contact on a part after which the next contact is another touch. Assumed: hands tap more
slowly, and a hand that slides over a gap in the skin is away for a shorter time."""
LEAST_FORCE = 0.1
"""Contacts [N] whose peak is below this are no touches. Assumed."""
MOVED = 0.03
"""Way [m] along the skin from which a touch is a stroke. Assumed: poking hands roll and slip by less."""
QUICK, SHORT = 0.15, 0.6
"""Lengths [s]: a touch up to the first is a tap, or a hit from `HARD` on; up to the second a poke. Assumed,
from the ranges of these kinds."""
HARD = 12.0
"""Peak [N] from which a quick touch is a hit."""
NEAR = 0.03
"""Distance [m] up to which a touch beside an arm is told as a place in words, not as a taxel. Assumed."""


def observe(perceptions: Iterable[Perception], body: GenericBody) -> tuple[Touch, ...]:
    """The touches of one robot, as others could be asked to do them; times count from the first perception.

    Of several contacts on a part the strongest counts. The kind is a guess from way, length and force:
    stroke, tap, hit, poke or press. Places on arms are exact, in words that fit every robot; other places are
    the nearest words, or a taxel of this robot if there are none within 3 cm.
    """
    begun: float | None = None
    tracks: dict[str, list[Contact]] = {}
    found: list[Touch] = []
    for perception in perceptions:
        begun = perception.stamp if begun is None else begun
        strongest: dict[str, Contact] = {}
        for contact in perception.contacts:
            if contact.force > getattr(strongest.get(contact.part), "force", 0.0):
                strongest[contact.part] = contact
        for part, contact in strongest.items():
            track = tracks.setdefault(part, [])
            if track and (contact.stamp - track[-1].stamp > GAP or contact.patch != track[-1].patch):
                found += _touch(tracks.pop(part), body, begun)
                track = tracks.setdefault(part, [])
            if not track or contact.stamp > track[-1].stamp:
                track.append(contact)
    for track in tracks.values():
        found += _touch(track, body, begun or 0.0)
    return tuple(sorted(found, key=lambda touch: touch.onset or 0.0))


def _touch(track: list[Contact], body: GenericBody, begun: float) -> list[Touch]:
    forces = np.array([contact.force for contact in track])
    times = np.array([contact.stamp for contact in track])
    rate = body.robot.patch(track[0].patch).rate
    duration = float(times[-1] - times[0] + 1.0 / rate)
    if forces.max() < LEAST_FORCE:
        return []
    points = np.array([contact.p_L for contact in track])
    way = float(np.linalg.norm(np.ptp(points, axis=0)))
    moved = way >= MOVED and len(track) > 4
    speed = (
        float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum() / (times[-1] - times[0]))
        if moved
        else None
    )
    quick = duration <= QUICK
    kind = "stroke" if moved else ("hit" if forces.max() >= HARD else "tap") if quick else "poke"
    kind = "press" if kind == "poke" and duration > SHORT else kind
    force = float(forces.max() if duration <= SHORT and not moved else np.median(forces))
    return [
        Touch(
            kind,
            _place(track, body, moved=moved),
            round(float(times[0]) - begun, 3),
            float(np.clip(round(duration, 3), *DURATIONS)),
            force=float(np.clip(round(force, 3), *FORCES)),
            speed=None if speed is None else float(np.clip(round(speed, 4), *SPEEDS)),
        )
    ]


def _place(track: list[Contact], body: GenericBody, *, moved: bool) -> str:
    first = max(track, key=lambda contact: contact.force)
    part = body.robot.part(first.part)
    if part.kind == "arm" and first.segment in SEGMENTS:
        theta = float(np.angle(np.mean(np.exp(1j * np.array([contact.theta for contact in track])))))
        along = np.clip([contact.u for contact in track], 0.0, 1.0)
        words = words_of(part, LimbPlace(first.segment, float(np.median(along)), theta))
        if not moved or abs(along[-1] - along[0]) < 0.02:
            return words
        return f"{words.rpartition(' ')[0]} {along[0]:.2f}..{along[-1]:.2f}"
    best: tuple[float, str] | None = None
    for words in place_words(body):
        try:
            place = find_spot(body, words).place
        except TciError:
            continue
        apart = float(np.linalg.norm(place.p_L - first.p_L)) if place.patch == first.patch else np.inf
        if apart < NEAR and (best is None or apart < best[0]):
            best = apart, words
    if best is not None:
        return best[1]
    positions = body.skin.surfaces[first.patch].positions
    return f"{first.patch} taxel {int(np.linalg.norm(positions - first.p_L, axis=1).argmin())}"
