"""Terminal output: tables on the console, JSON for programs."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console

console = Console()


def print_json(value: Any) -> None:
    """Prints JSON without colours and without line wrapping. Raises ValueError for NaN and infinity."""
    print(json.dumps(value, indent=2, allow_nan=False))


@contextmanager
def told_here() -> Iterator[None]:
    """Keeps the log of `tci` off the screen, for a command that prints the same events itself."""
    log, quiet = logging.getLogger("tci"), logging.NullHandler()
    log.addHandler(quiet)
    try:
        yield
    finally:
        log.removeHandler(quiet)
