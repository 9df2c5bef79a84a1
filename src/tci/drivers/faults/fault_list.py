"""The catalogue of faults: number, what happens, what is expected, which test shows it or what is missing."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).parent / "faults.toml"


@dataclass(frozen=True, slots=True)
class KnownFault:
    """One row of the catalogue."""

    number: int
    """Its number, which tests name."""
    fault: str
    """What happens."""
    expected: str
    """What TCI must do then."""
    test: str
    """`path::test` that shows it; empty while the fault is open."""
    missing: str
    """The part that is missing; empty once it is tested."""


def _load() -> dict[int, KnownFault]:
    rows = tomllib.loads(FILE.read_text())["fault"]
    return {
        row["number"]: KnownFault(test=row.pop("test", ""), missing=row.pop("missing", ""), **row)
        for row in rows
    }


FAULTS = _load()
"""All 58, by number."""
