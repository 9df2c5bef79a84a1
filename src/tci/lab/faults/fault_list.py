"""The catalogue of faults. Each row contains a number, a description, the required reaction, and the test of
the reaction. If a fault can't be tested yet, the row names instead what TCI lacks for the test."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

FILE = Path(__file__).parent / "faults.toml"


@dataclass(frozen=True, slots=True)
class KnownFault:
    """One row of the catalogue of faults."""

    number: int
    """Number of the fault. Tests refer to the fault by this number."""
    fault: str
    """Description of the fault."""
    expected: str
    """Required reaction of TCI."""
    test: str
    """Test that checks the reaction, as `path::test`. The text is empty if the fault has no test."""
    missing: str
    """Part of TCI that is missing, so that no test of this fault is possible. The text is empty if the fault
    has a test."""


def _load() -> dict[int, KnownFault]:
    rows = tomllib.loads(FILE.read_text())["fault"]
    return {
        row["number"]: KnownFault(test=row.pop("test", ""), missing=row.pop("missing", ""), **row)
        for row in rows
    }


FAULTS = _load()
"""All 58 faults, by number."""
