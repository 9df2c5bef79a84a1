"""What a person types at a terminal while a robot runs: `reset` and `free`, each with Enter."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable

from tci.errors import CommandError
from tci.gate.gate import Gate

HINT = "type reset, or free to move a part slowly away from what it presses, and Enter"


class Operator:
    """Reads the terminal between two periods, without waiting. In the background, or where the input is no
    terminal, it reads nothing."""

    def __init__(self, gate: Gate, *, file: int | None = None) -> None:
        """`file` is the descriptor that is read; None is the terminal, if the input is one."""
        self._verbs: dict[str, Callable[[], None]] = {"reset": gate.reset, "free": gate.free}
        if file is None and os.name == "posix" and sys.stdin is not None and sys.stdin.isatty():
            file = sys.stdin.fileno()
        self._file = file

    @property
    def present(self) -> bool:
        """True if somebody can type. Reading in the background would stop the process."""
        if self._file is None:
            return False
        try:
            return os.tcgetpgrp(self._file) == os.getpgrp()
        except OSError:  # not the terminal that controls this process, which anybody may read
            return True

    def listen(self) -> list[str]:
        """Carries out the lines that were typed; what to print about each. Call it where the gate is
        stepped."""
        if not (self._file is not None and select.select([self._file], [], [], 0.0)[0] and self.present):
            return []
        typed = os.read(self._file, 1000)
        if not typed:  # the terminal is gone
            self._file = None
        return [self._carry_out(line) for line in typed.decode(errors="replace").split("\n") if line.strip()]

    def _carry_out(self, line: str) -> str:
        verb = line.strip().lower()
        if verb not in self._verbs:
            return f"{verb[:40]!r} is unknown; valid: {', '.join(self._verbs)}"
        try:
            self._verbs[verb]()
        except CommandError as error:
            return f"{verb} is refused: {error}"
        return f"{verb} by the operator"
