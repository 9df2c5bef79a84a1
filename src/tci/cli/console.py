"""Terminal output: tables on the console, JSON for programs."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

console = Console()


def print_json(value: Any) -> None:
    """Prints JSON without colours and without line wrapping. Raises ValueError for NaN and infinity."""
    print(json.dumps(value, indent=2, allow_nan=False))


@contextmanager
def told_here() -> Iterator[None]:
    """Hides what `tci.run` logs inside the `with` block, for a command that tells these events itself."""
    log, quiet = logging.getLogger("tci.run"), logging.NullHandler()
    log.addHandler(quiet)
    try:
        yield
    finally:
        log.removeHandler(quiet)


def written(
    out: Path, counts: Mapping[str, int], more: Mapping[str, Any] | None = None, *, as_json: bool
) -> None:
    """Prints the path, the size and the number of messages of a recording that was written. With JSON output,
    also prints the values in `more`."""
    size = out.stat().st_size
    if as_json:
        print_json({"file": str(out), "bytes": size, **counts, **(more or {})})
        return
    words = "".join(f"{number} {what.replace('_', ' ')}, " for what, number in counts.items())
    console.print(f"{out}: {words}{size / 1e6:.2f} MB", highlight=False, markup=False)
