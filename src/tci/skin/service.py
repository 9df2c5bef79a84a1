"""One acquisition, many readers: each takes skin frames at its own rate, and none slows the acquisition.

In Skinware's sense (Youssefi et al. 2015): the writer publishes every state of the skin into a ring and waits
for nobody; a reader has a place of its own in that ring. What a slow reader misses is counted.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Literal

from tci.errors import TciError, UnknownNameError
from tci.messages import SkinState
from tci.skin.regions import Region, RegionState, region_state
from tci.skin.skin import Skin

Mode = Literal["every", "latest", "change"]
MODES: tuple[Mode, ...] = ("every", "latest", "change")
DEPTH = 256
"""States that the ring holds. Ours: 5 s of an iCub's skin."""


class SkinService:
    """Publishes the states of one skin. `publish` belongs to one thread, readers to any."""

    def __init__(self, skin: Skin, *, depth: int = DEPTH) -> None:
        """`depth` is how many states a reader may be late before it misses any. Raises TciError below 1."""
        if depth < 1:
            raise TciError(f"a ring of {depth} states; valid: 1 or more")
        self.skin = skin
        # One place more than promised: the writer may be filling it while a reader looks.
        self._ring: list[SkinState | None] = [None] * (depth + 1)
        self._published = 0
        self._waiting = 0
        self._fresh = threading.Condition()

    @property
    def published(self) -> int:
        """States until now."""
        return self._published

    def publish(self, state: SkinState) -> None:
        """Give all readers a new state. It costs the same for any number of them, and never waits for one."""
        if self._published and state is self._ring[(self._published - 1) % len(self._ring)]:
            return
        self._ring[self._published % len(self._ring)] = state
        self._published += 1
        if self._waiting:
            with self._fresh:
                self._fresh.notify_all()

    def reader(self, mode: Mode = "every", *, region: Region | None = None, step: float = 0.0) -> SkinReader:
        """A new reader, who sees what is published from now on.

        `every`: each state in turn. `latest`: the newest one, those between are passed over. `change`: the
        newest one in which the force on any patch (or the region's) differs by more than `step` [N] from what
        it saw last. Raises UnknownNameError for another mode, TciError for a bad step.
        """
        return SkinReader(self, mode, region, step)

    def _get(self, index: int) -> SkinState | None:
        """State `index`; None when the ring has moved on."""
        state = self._ring[index % len(self._ring)]
        # Read first, look then: a writer that came between has moved `_published` on.
        return state if self._published - index < len(self._ring) else None

    def _oldest(self) -> int:
        return max(self._published - len(self._ring) + 1, 0)

    def _wait(self, index: int, timeout: float | None) -> bool:
        """Wait until state `index` is published, at most `timeout` [s]; whether it is."""
        if self._published > index:
            return True
        self._waiting += 1
        try:
            with self._fresh:
                # A state may come between the look at `_waiting` and this wait; it is seen within 50 ms.
                end = None if timeout is None else time.monotonic() + timeout
                while self._published <= index:
                    left = 0.05 if end is None else min(0.05, end - time.monotonic())
                    if left <= 0.0:
                        return False
                    self._fresh.wait(left)
        finally:
            self._waiting -= 1
        return True


class SkinReader:
    """One reader's place in the ring. An object serves one thread."""

    def __init__(self, service: SkinService, mode: Mode, region: Region | None, step: float) -> None:
        if mode not in MODES:
            raise UnknownNameError("mode of a reader", mode, MODES)
        if not 0.0 <= step < float("inf"):
            raise TciError(f"a step of {step} N; valid: 0 or more, finite")
        self.mode = mode
        self.missed = 0
        """States that an `every` reader was too slow for."""
        self._service = service
        self._region = region
        self._step = step
        self._next = service.published
        self._forces: dict[str, float] | None = None

    def read(self, timeout: float | None = None) -> SkinState | None:
        """The next state for this reader; None when none came within `timeout` [s] (None: wait for ever)."""
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            left = None if end is None else max(end - time.monotonic(), 0.0)
            if not self._service._wait(self._next, left):
                return None
            if self.mode != "every":
                self._next = self._service.published - 1
            state = self._service._get(self._next)
            if state is None:
                oldest = self._service._oldest()
                self.missed += oldest - self._next
                self._next = oldest
                continue
            self._next += 1
            if self.mode != "change" or self._changed(state):
                return state

    def figures(self, state: SkinState) -> RegionState:
        """The figures of this reader's region. Raises TciError for a reader without one."""
        if self._region is None:
            raise TciError("this reader has no region; valid: reader(region=...)")
        return region_state(self._service.skin, self._region, state)

    def __iter__(self) -> Iterator[SkinState]:
        while (state := self.read()) is not None:
            yield state

    def _changed(self, state: SkinState) -> bool:
        if self._region is not None:
            forces = {self._region.name: self.figures(state).force}
        else:
            surfaces = self._service.skin.surfaces
            felt = state.by_patch(patch.name for patch in self._service.skin.robot.patches)
            forces = {name: float(felt[name] @ surfaces[name].areas) for name in felt}
        before = self._forces
        same = before is not None and before.keys() == forces.keys()
        if before is not None and same and all(abs(forces[n] - before[n]) <= self._step for n in forces):
            return False
        self._forces = forces
        return True
