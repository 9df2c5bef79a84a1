"""Habits of a capability that nobody notices in simulation: it keeps state in itself, or a step takes longer
than a period."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from tci.capabilities.capability import Capability
from tci.capabilities.wrapper import unwrapped
from tci.runtime.loop_report import Histogram


class Habits:
    """Watches one run of a capability."""

    def __init__(self, capability: Capability[Any], period: float) -> None:
        """`period` [s] is that of the loop."""
        self._capability, self._period = unwrapped(capability), period
        self._before = self._own()
        self._steps = Histogram()

    def add(self, seconds: float) -> None:
        """Adds the time [s] that one step took."""
        self._steps.add(seconds)

    def advice(self) -> tuple[str, ...]:
        """One sentence for each such habit, with what to do."""
        name, found = type(self._capability).__name__, []
        changed = [key for key, kept in self._own().items() if not _same(kept, self._before.get(key, ...))]
        if changed:
            found.append(
                f"{name} keeps state in itself ({', '.join(changed)}), so the next run and a replay begin "
                "with what this run left; valid: memory, the value that step gets and returns"
            )
        # The median: a busy machine interrupts some steps for longer than a period.
        if (took := self._steps.quantile(0.5)) > self._period:
            found.append(
                f"a step of {name} takes {1e3 * took:.3g} ms, longer than a period of {1e3 * self._period:g} "
                "ms; a robot does not wait; valid: less in a step, or a tci.Stepper beside it"
            )
        return tuple(found)

    def _own(self) -> dict[str, Any]:
        """The public attributes; of those that may grow, a copy. Private ones may be caches."""
        own = getattr(self._capability, "__dict__", {})
        cached = {
            key for key in own if isinstance(getattr(type(self._capability), key, None), cached_property)
        }
        return {
            key: value.copy() if isinstance(value, list | dict | set | np.ndarray) else value
            for key, value in own.items()
            if not key.startswith("_") and key not in cached
        }


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, list | dict | set) and type(one) is type(other):
        return len(one) == len(other)
    return one is other
