"""How tables and JSON are printed."""

from __future__ import annotations

import json
from typing import Any

from rich.console import Console

console = Console()


def print_json(value: Any) -> None:
    """Print JSON for programs: no colours, no wrapping."""
    print(json.dumps(value, indent=2, allow_nan=False))
