"""Lines of a run on the terminal: of each cause one a second, with how often it came and its worst case."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

from tci.cli.run_log import Event
from tci.reasons import kind_of

SECOND = 1.0
"""Shortest time [s] between two lines of one cause."""
NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(slots=True)
class _Cause:
    since: float
    """Time [s] of its last line."""
    repeats: list[Event] = field(default_factory=list)
    """What came after that."""


class Repeats:
    """Passes the first event of a cause to `show` at once, and what follows within a second as one more
    event. Events whose words differ only in numbers have one cause. A STOP is always shown."""

    def __init__(self, show: Callable[[Event], None]) -> None:
        self._show = show
        self._causes: dict[tuple[str, str], _Cause] = {}

    def add(self, event: Event) -> None:
        """Shows an event, or keeps it until its second is over."""
        self.pass_time(event.now)
        key = event.kind, kind_of(event.words)
        if key not in self._causes or event.kind == "STOP":
            self._causes[key] = _Cause(event.now)
            self._show(event)
        else:
            self._causes[key].repeats.append(event)

    def pass_time(self, now: float) -> None:
        """Shows what was kept for a second before `now` [s]."""
        for key, cause in [*self._causes.items()]:
            if now - cause.since >= SECOND:
                self._tell(cause)
                self._causes[key] = _Cause(now)
                if not cause.repeats:
                    del self._causes[key]

    def end(self) -> None:
        """Shows all that was kept."""
        for cause in self._causes.values():
            self._tell(cause)
        self._causes.clear()

    def _tell(self, cause: _Cause) -> None:
        if not cause.repeats:
            return
        worst = max(cause.repeats, key=lambda event: [float(one) for one in NUMBER.findall(event.words)])
        count = len(cause.repeats)
        words = f"{count} more times, at worst: {worst.words}" if count > 1 else worst.words
        self._show(Event(cause.repeats[-1].now, worst.kind, words))
