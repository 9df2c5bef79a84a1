"""Words in the names of links and sites that tell pads: `LFsrFL_frame` is l, fsr, fl, frame."""

from __future__ import annotations

import re
from itertools import pairwise

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
_CLAIMED = ("tactile", "taxel", "taxels", "touch", "skin", "fsr", "bumper")
_OFFERED = ("pad", "pads")
_FINGERS = {
    "thumb": "thumb", "th": "thumb", "index": "index", "ff": "index", "middle": "middle", "mf": "middle",
    "ring": "ring", "rf": "ring", "little": "little", "pinky": "little", "lf": "little", "palm": "palm",
}  # fmt: skip


def words(name: str) -> tuple[str, ...]:
    """The words of a name, in lower case: split at everything that is no letter, and at CamelCase."""
    return tuple(word.lower() for word in _WORD.findall(name))


def claims(name: str) -> bool:
    """True if a name says that something here feels touch."""
    own = words(name)
    return any(word in _CLAIMED for word in own) or ("force", "sensor") in pairwise(own)


def offers(name: str) -> bool:
    """True for a contact surface (`left_pad`), of which a name doesn't say that it feels anything."""
    return any(word in _OFFERED for word in words(name))


def finger(name: str) -> str | None:
    """The finger that a name tells, or "palm"."""
    return next((_FINGERS[word] for word in words(name) if word in _FINGERS), None)


def stem(name: str) -> tuple[str, int | None]:
    """A name without the number at its end, and this number: members of an array share the stem."""
    found = re.fullmatch(r"(.*?)_?(\d+)", name)
    return (found[1], int(found[2])) if found else (name, None)
