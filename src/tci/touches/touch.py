"""One touch of one person, as data and as a line of words."""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass

from tci.errors import CommandError
from tci.touches.kinds import STRENGTHS, Kind, kind_named

SIDES = ("left", "right", "both")
FORCES = 0.05, 100.0
"""Valid forces [N]: from what no robot's skin feels to a hard blow. Assumed."""
SPEEDS = 0.005, 2.0
"""Valid speeds along the skin [m/s]. Assumed."""
DURATIONS = 0.02, 600.0
_UNITS = {
    "N": ("force", 1.0), "m/s": ("speed", 1.0), "cm/s": ("speed", 1e-2), "mm/s": ("speed", 1e-3),
    "s": ("duration", 1.0), "ms": ("duration", 1e-3),
}  # fmt: skip
_QUANTITY = re.compile(r"(@?)(\d+(?:\.\d+)?)(N|cm/s|mm/s|m/s|ms|s)")
_WRONG = re.compile(r"@.*|[+-]?[\d.,]+(N|[cm]?m(/s)?|m?s|k?g)", re.IGNORECASE)
"""A quantity that `_QUANTITY` does not know, and no word of a place."""


@dataclass(frozen=True, slots=True)
class Touch:
    """What one hand does at one place. What is None follows from the kind and the person."""

    kind: str
    """A name in the table of kinds."""
    place: str
    """Plain words with a side, for any robot (`left forearm outside`, `back of right hand`, `belly`), or a
    patch of one robot (`left_forearm`, `left_forearm taxel 12`). A number or a range at the end says where
    along the limb: `left forearm 0.2..0.8`, from 0 at its upper joint to 1 at its lower one; `100deg` says
    where around it."""
    onset: float | None = None
    """Time [s] at which it begins; None: half a second after the end of the touch before."""
    duration: float | None = None
    """[s]; None: as long as the kind takes."""
    hand: str = "right"
    """Hand of the person: left, right or both."""
    force: float | None = None
    """[N] of one hand: the peak of a pulse, else the steady force."""
    speed: float | None = None
    """Speed [m/s] along the skin."""
    strength: str = "normal"
    """gentle, normal or rough, as in CoST; `force` says it exactly."""
    person: str = ""
    """Name of the person who touches; empty for the average person."""
    act: str = ""
    """Touches with the same `act` belong together: two hands, a hug, a grip."""

    def __post_init__(self) -> None:
        """Raises CommandError with all faults; kinds and places are checked when it is planned."""
        faults = [
            *_outside("onset", self.onset, 0.0, math.inf, "s"),
            *_outside("duration", self.duration, *DURATIONS, "s"),
            *_outside("force", self.force, *FORCES, "N"),
            *_outside("speed", self.speed, *SPEEDS, "m/s"),
            *_unknown("hand", self.hand, SIDES),
            *_unknown("strength", self.strength, STRENGTHS),
        ]
        if not self.place.strip():
            faults.append("no place; valid: words such as 'left forearm', or the name of a patch")
        if faults:
            raise CommandError(f"touch {self.kind!r}: {'; '.join(faults)}")


def parse_touch(text: str, kinds: Mapping[str, Kind] | None = None) -> Touch:
    """A touch from words: the kind, the place, and in any order what else is known.

        stroke 'left forearm' 0.2..0.8 3N 8cm/s
        poke left_forearm taxel 12 2N @0.5s
        pat back of right hand gentle 2s by ada with left hand

    `3N` is the force, `8cm/s` the speed, `2s` the duration, `@0.5s` the onset. Raises CommandError or
    UnknownNameError.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise CommandError(f"touch {text!r}: {error}; valid: {EXAMPLE}") from None
    if not words:
        raise CommandError(f"an empty touch; valid: {EXAMPLE}")
    kind = kind_named(words.pop(0), kinds).name
    found: dict[str, float | str] = {}
    place: list[str] = []
    while words:
        word = words.pop(0)
        if match := _QUANTITY.fullmatch(word):
            name, factor = _UNITS[match[3]]
            name = "onset" if match[1] else name
            _put(found, name, float(match[2]) * factor, text)
        elif word in STRENGTHS:
            _put(found, "strength", word, text)
        elif word == "by" and words:
            _put(found, "person", words.pop(0), text)
        elif word == "with" and len(words) > 1 and words[1] in ("hand", "hands"):
            _put(found, "hand", words.pop(0), text)
            words.pop(0)
        elif _WRONG.fullmatch(word):
            raise CommandError(f"touch {text!r}: {word!r}; valid: {EXAMPLE}")
        else:
            place.append(word)
    if not place:
        raise CommandError(f"touch {text!r}: no place; valid: {EXAMPLE}")
    return Touch(kind, " ".join(place), **found)  # type: ignore[arg-type]


EXAMPLE = "KIND PLACE [3N] [8cm/s] [2s] [@ONSETs] [gentle|normal|rough], e.g. stroke 'left forearm' 3N"


def _put(found: dict[str, float | str], name: str, value: float | str, text: str) -> None:
    if name in found:
        raise CommandError(f"touch {text!r}: {name} given twice; valid: {EXAMPLE}")
    found[name] = value


def _outside(name: str, value: float | None, low: float, high: float, unit: str) -> list[str]:
    if value is None or (low <= value <= high and math.isfinite(value)):
        return []
    until = f" to {high:g}" if math.isfinite(high) else " or more"
    return [f"{name} {value:g} {unit}; valid: {low:g}{until} {unit}"]


def _unknown(name: str, value: str, valid: tuple[str, ...]) -> list[str]:
    return [] if value in valid else [f"no {name} named {value!r}; valid: {', '.join(valid)}"]
