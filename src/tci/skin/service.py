"""One writer and many readers of the states of a skin.

Each reader has its own rate, and no reader slows the writer down. The writer puts every state of the skin
into a ring buffer and never waits. Each reader has its own index into this buffer (as in Skinware, Youssefi
et al. 2015). States that a slow reader misses are counted in `SkinReader.missed`.
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
"""Number of states in the ring buffer: 5 s of an iCub's skin at 50 Hz. Assumed: a reader never lags by more.
"""


class SkinService:
    """Publishes the states of one skin to many readers.

    One thread may call `publish`. Any thread may read.
    """

    def __init__(self, skin: Skin, *, depth: int = DEPTH) -> None:
        """Starts with an empty ring buffer of `depth` states.

        A reader that lags by more than `depth` states misses some states. Raises TciError if `depth` is below
        1.
        """
        if depth < 1:
            raise TciError(f"a ring of {depth} states; valid: 1 or more")
        self.skin = skin
        # The ring has one slot more than `depth`: the writer may be filling this slot while a reader reads.
        self._ring: list[SkinState | None] = [None] * (depth + 1)
        self._published = 0
        self._waiting = 0
        self._fresh = threading.Condition()

    @property
    def published(self) -> int:
        """Number of states published so far."""
        return self._published

    def publish(self, state: SkinState) -> None:
        """Publishes a new state.

        The call takes equally long for any number of readers, and never waits for a reader.
        """
        if self._published and state is self._ring[(self._published - 1) % len(self._ring)]:
            return
        self._ring[self._published % len(self._ring)] = state
        self._published += 1
        if self._waiting:
            with self._fresh:
                self._fresh.notify_all()

    def reader(self, mode: Mode = "every", *, region: Region | None = None, step: float = 0.0) -> SkinReader:
        """Returns a new reader, which starts with the next state to be published.

        The mode selects the states that the reader receives:

        - `every`: each state in turn.
        - `latest`: the newest state. Earlier states are skipped.
        - `change`: the newest state in which the force on any patch (or on the `region`, if given) differs by
          more than `step` [N] from the last state that was read.

        Raises UnknownNameError for another mode. Raises TciError for a negative or infinite step.
        """
        return SkinReader(self, mode, region, step)

    def _get(self, index: int) -> SkinState | None:
        """Returns the state of the skin with the number `index`, or None if newer states have replaced this
        state."""
        state = self._ring[index % len(self._ring)]
        # The index is checked after reading: a writer that overwrote the slot meanwhile has also increased
        # `_published`.
        return state if self._published - index < len(self._ring) else None

    def _oldest(self) -> int:
        return max(self._published - len(self._ring) + 1, 0)

    def _wait(self, index: int, timeout: float | None) -> bool:
        """Waits until the state of the skin with the number `index` is published, but at most `timeout` [s]
        (None: without a limit). Returns True if the state is published."""
        if self._published > index:
            return True
        self._waiting += 1
        try:
            with self._fresh:
                # A state may be published between the check of `_waiting` and this wait. The wait then ends
                # after at most 50 ms.
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
    """A reader's position in the ring buffer. Each thread needs its own reader."""

    def __init__(self, service: SkinService, mode: Mode, region: Region | None, step: float) -> None:
        if mode not in MODES:
            raise UnknownNameError("mode of a reader", mode, MODES)
        if not 0.0 <= step < float("inf"):
            raise TciError(f"a step of {step} N; valid: 0 or more, finite")
        self.mode = mode
        self.missed = 0
        """Number of states that were overwritten before this reader read them. Only counted in mode `every`.
        """
        self._service = service
        self._region = region
        self._step = step
        self._next = service.published
        self._forces: dict[str, float] | None = None

    def read(self, timeout: float | None = None) -> SkinState | None:
        """Returns the next state for this reader, or None if no state was published within `timeout` [s].

        With `timeout` None the reader waits indefinitely.
        """
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
        """Returns the statistics of this reader's region in `state`.

        Raises TciError if the reader has no region.
        """
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
            pressure = state.by_patch(patch.name for patch in self._service.skin.robot.patches)
            forces = {name: float(pressure[name] @ surfaces[name].areas) for name in pressure}
        before = self._forces
        same = before is not None and before.keys() == forces.keys()
        if before is not None and same and all(abs(forces[n] - before[n]) <= self._step for n in forces):
            return False
        self._forces = forces
        return True
