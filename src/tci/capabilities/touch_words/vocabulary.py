"""Which words a skin can tell: fewer on few channels, fewest on switches. The table is `words.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from tci.robot.description import Patch

FEW = 12
"""Number of channels up to which a patch counts as a skin with few channels."""
_TABLE = tomllib.loads(Path(__file__).with_name("words.toml").read_text(encoding="utf-8"))
FEW_WORDS: Mapping[str, str] = MappingProxyType(
    {word: name for name, words in _TABLE["few"].items() for word in words}
)
"""The word that a skin with few channels tells for each word."""
SWITCH_WORDS = "tap", "press"
"""Words of a switch: pressed shortly, pressed for longer than `HELD`."""
HELD = float(_TABLE["switches"]["held"])


def is_few(patch: Patch) -> bool:
    return patch.channels <= FEW


def merged(chances: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of the words of a skin with few channels."""
    found: dict[str, float] = {}
    for word, chance in chances.items():
        name = FEW_WORDS.get(word, word)
        found[name] = found.get(name, 0.0) + chance
    return found
