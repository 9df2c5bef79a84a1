"""How tables and JSON are printed."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console

console = Console()


def print_json(value: Any) -> None:
    """Print JSON for programs: no colours, no wrapping."""
    print(json.dumps(value, indent=2, allow_nan=False))


@contextmanager
def told_here() -> Iterator[None]:
    """Keeps the log of a run off the screen, for a command that prints the same itself."""
    log, quiet = logging.getLogger("tci"), logging.NullHandler()
    log.addHandler(quiet)
    try:
        yield
    finally:
        log.removeHandler(quiet)
