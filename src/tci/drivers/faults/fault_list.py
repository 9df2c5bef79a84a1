"""The catalogue of faults: number, fault, expected reaction, and the test that shows it or the missing
part."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).parent / "faults.toml"


@dataclass(frozen=True, slots=True)
class KnownFault:
    """One row of the catalogue."""

    number: int
    """Number of the fault; tests refer to it."""
    fault: str
    """Description of the fault."""
    expected: str
    """Required reaction of TCI."""
    test: str
    """`path::test` that shows the reaction; empty while there is none."""
    missing: str
    """Part that is missing; empty once the fault is tested."""


def _load() -> dict[int, KnownFault]:
    rows = tomllib.loads(FILE.read_text())["fault"]
    return {
        row["number"]: KnownFault(test=row.pop("test", ""), missing=row.pop("missing", ""), **row)
        for row in rows
    }


FAULTS = _load()
"""All 58 faults, by number."""
