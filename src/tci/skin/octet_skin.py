"""The fast way for 8-bit skin: frames of all patches at once, in one compiled call.

It gives what each patch's `Conditioner` gives, which still learns, and which takes whatever else a sensor
sends: other numbers, three axes, a smoothed response.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.skin.conditioning import GAP, Conditioner
from tci.skin.felt import NOBODY, Pressed
from tci.skin.kernels.condition import CHANGED, FULL, HIGHEST, LOWEST, REST, ROWS, SIGN
from tci.skin.kernels.octet_counts import (
    BENT,
    BLOCK,
    CALM,
    CHANGES,
    DUE,
    ELAPSED,
    FIRST,
    FRAMES,
    IN_LESSON,
    LEAST,
    LOW,
    SATURATED,
    STAMP,
    TAXELS,
    spill,
)  # fmt: skip
from tci.skin.kernels.octets import feel, set_limits
from tci.skin.shear import AXES

_BYTES = np.arange(256, dtype=np.float32)


class OctetSkin:
    """The patches of a skin. `force` and `active` are of all patches, also of those that go the other way."""

    def __init__(self, conditioners: Sequence[Conditioner], areas: Sequence[Array]) -> None:
        """`areas` (n,) [m2] of each patch's taxels."""
        self.conditioners = conditioners
        sizes = [len(one.channels) for one in conditioners]
        blocks = [-(-size // BLOCK) for size in sizes]
        self.begins: list[int] = np.cumsum([0, *sizes]).tolist()
        """Where the taxels of each patch begin (p + 1,)."""
        first = np.cumsum([0, *blocks])
        count, whole = self.begins[-1], int(first[-1])
        ends = [_end(one) for one in conditioners]
        self.takes = [end is not None for end in ends]
        """Whether frames (p,) of bytes may come this way."""
        self.channels = [one.patch.channels for one in conditioners]
        sources = np.cumsum([0, *self.channels]).tolist()
        self._raw = np.zeros(sources[-1], np.uint8)
        self._sources = sources
        nodes = [one.nodes for one in conditioners]
        node = np.cumsum([0, *(one.shape[1] for one in nodes)])
        self._table = np.array(
            [
                (
                    self.begins[p], sizes[p], first[p], blocks[p], 255 if one.sign < 0 else 0, ends[p] or 0,
                    np.array_equal(one.channels, np.arange(sizes[p])), node[p], nodes[p].shape[1],
                    sources[p],
                )
                for p, one in enumerate(conditioners)
            ],
            np.int64,
        ).reshape(-1, 10)  # fmt: skip
        self._sensor = np.array([one.sensor for one in conditioners], np.float32).reshape(-1, 5)
        self._offset = np.zeros(count, np.float32)
        self._memory = np.zeros(ROWS * count, np.float32)
        self._octets, self._words = (
            np.zeros((7, BLOCK * whole), np.uint8),
            np.zeros((2, BLOCK * whole), np.uint16),
        )
        self._octets[LOW] = 255
        self._blocks, self._state = np.zeros((4, whole), np.int32), np.zeros((len(sizes), 11))
        self._state[:, STAMP], self._state[:, CALM] = np.nan, -1.0
        none = np.zeros(0, np.int64)
        self._indices = np.concatenate([none, *(one.channels for one in conditioners)])
        self._gain = np.concatenate([np.zeros(0), *(one.gain for one in conditioners)])
        self._nodes = np.ascontiguousarray(np.concatenate([np.zeros((2, 0)), *nodes], axis=1))
        self._area = np.concatenate([np.zeros(0), *areas])
        for table in (self._table, self._sensor, self._indices, self._gain, self._nodes, self._area):
            table.setflags(write=False)
        self.tables = (
            self._table, self._sensor, self._offset, self._memory, self._octets, self._words, self._blocks,
            self._state, self._indices, self._gain, self._nodes, self._area,
        )  # fmt: skip
        """What `feel` reads and remembers."""
        self.force = np.zeros(count)
        """Force (n,) [N] on every taxel now."""
        self.active = np.zeros(count, np.int32)
        """Taxels (n,) of each patch that feel something, from where the patch begins on."""
        self.counts = np.zeros(len(sizes), np.int64)
        """How many (p,) these are."""
        self.masks = tuple([one.masked for one in conditioners])
        """Which taxels (n,) of each patch (p,) are ignored; the same object until that changes."""
        self._felt, self._room = np.zeros(count), (np.zeros(count, np.int32), np.zeros(count))
        self._ends = np.zeros(len(sizes) + 1, np.int64)
        self._nobody: Pressed = NOBODY[0], NOBODY[1], self._ends.copy()
        self._last: list[NDArray[Any] | None] = []
        self._before: dict[int, NDArray[Any] | None] = {}
        self._held, self._still = set[int](), set[int]()
        self._ended, self._which = list[int](), list[int]()
        self._kinds = np.zeros(0, np.int64)
        self._view()
        for p in range(len(conditioners)):
            if self.takes[p]:
                self._load(p)

    def _view(self) -> None:
        """Views of the whole arrays: room for each patch's frame, and the memory of its conditioner."""
        # To types, arrays are buffers from Python 3.12 on.
        self._slots: list[Any] = [self._raw[begin:end].data for begin, end in pairwise(self._sources)]
        for p, one in enumerate(self.conditioners):
            if self.takes[p]:
                one.memory = self._memory[ROWS * self.begins[p] : ROWS * self.begins[p + 1]].reshape(ROWS, -1)

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_slots"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._view()

    @property
    def stamps(self) -> Array:
        """When each patch (p,) was measured last [s], as it is now; NaN: never."""
        return self._state[:, STAMP]

    def feel(self, which: list[int], values: list[NDArray[Any]], stamps: list[float]) -> Pressed | None:
        """What all patches feel after frames of the patches `which` (k > 0), none of them twice; None, and
        nothing is done, where one of the frames must go the other way.

        A read-only array that came twice is the same frame when it comes again, and is only counted.
        """
        while self._ended:
            self.learn()
            if not all(self.takes[p] for p in which):
                return None
        if which != self._which:
            self._before.update(zip(self._which, self._last, strict=True))
            self._last = [self._before.get(p) for p in which]
            self._which, self._kinds = which, np.array(which, np.int64)
        kinds, held = self._kinds, self._held
        fresh: Iterable[tuple[int, NDArray[Any]]] = zip(which, values, strict=True)
        same = list(map(is_, values, self._last))
        all_again = all(same) and held.issuperset(which)
        if all_again:
            kinds, fresh = -1 - kinds, ()
        elif held and True in same:
            again = [s and p in held for p, s in zip(which, same, strict=True)]
            kinds = np.array([-1 - p if a else p for p, a in zip(which, again, strict=True)], np.int64)
            fresh = [(p, v) for p, v, a in zip(which, values, again, strict=True) if not a]
        try:
            for p, octets in fresh:
                self._slots[p][:] = octets
        except (TypeError, ValueError):  # other numbers, or not as many
            return None
        taxels, pressure = self._room
        due = feel(
            self._raw, kinds, np.fromiter(stamps, np.float64), GAP, *self.tables, self.force, self.active,
            self._felt, self.counts, taxels, pressure, self._ends,
        )  # fmt: skip
        if due < 0:
            return None
        if not all_again:
            self._last = [*values]
            self._hold(which, values, same)
        if self._still:
            self._revive([p for p in kinds.tolist() if p in self._still])
        if due:
            elapsed, lesson, frames, least = self._state[which][:, [ELAPSED, DUE, IN_LESSON, LEAST]].T
            self._ended = [which[k] for k in np.flatnonzero((elapsed >= lesson) & (frames >= least))]
        found = self._ends[-1]
        if not found:
            return self._nobody
        return taxels[:found].copy(), pressure[:found].copy(), self._ends.copy()

    def fits(self, p: int, values: NDArray[Any]) -> bool:
        """Whether a frame of patch `p` may come this way."""
        if not self.takes[p] or values.dtype != np.uint8 or values.shape != (self.channels[p],):
            return False
        one = self.conditioners[p]
        own = values[one.channels]
        return bool(((own >= one.sensor[LOWEST]) & (own <= one.sensor[HIGHEST])).all())

    def _hold(self, which: list[int], values: list[NDArray[Any]], same: list[bool]) -> None:
        """Note which frames need not be looked at when they come again."""
        if not self._held and True not in same:
            return
        for p, v, s in zip(which, values, same, strict=True):
            if s and not v.flags.writeable and p not in self._still:
                self._held.add(p)
            else:
                self._held.discard(p)

    def catch_up(self) -> None:
        """Learn from all lessons that have ended."""
        while self.learn():
            pass

    def learn(self) -> bool:
        """Learn half of one lesson that has ended; false if none has. It takes longer than a frame."""
        if self._ended:
            p = self._ended[-1]
            one = self.conditioners[p]
            if not one.halfway:
                self.sync(p)
            if one.learn():
                self._ended.pop()
                self._load(p)
            return True
        for one in self.conditioners:
            if one.ended:
                if one.learn():
                    self._mask()
                return True
        return False

    def put(self, p: int, force: Array, stamp: float) -> None:
        """The force (n,) [N] at `stamp` [s] on a patch that goes the other way."""
        self._state[p, STAMP] = stamp
        if self.masks[p] is not self.conditioners[p].masked:
            self._mask()
        begin = self.begins[p]
        active = np.flatnonzero(force)
        self.force[begin : begin + len(force)] = force
        self.active[begin : begin + len(active)] = active
        self.counts[p] = len(active)

    def retire(self, p: int) -> None:
        """From now on a patch goes the other way."""
        if self.takes[p]:
            self.catch_up()
            self.sync(p)
            self.takes[p] = False

    def sync(self, p: int) -> None:
        """The patch's conditioner knows all that was seen until now."""
        if self.takes[p]:
            spill(
                p, self._table, self._sensor, self._offset, self._memory, self._octets, self._words,
                self._blocks, self._state,
            )  # fmt: skip
            state = self._state[p].tolist()
            self.conditioners[p].resume(
                stamp=None if np.isnan(state[STAMP]) else state[STAMP],
                elapsed=state[ELAPSED],
                frames=int(state[FRAMES]),
                in_lesson=int(state[IN_LESSON]),
                bends=int(state[BENT]),
                saturated=int(state[SATURATED]),
            )

    def saturated(self, p: int) -> int:
        """Taxels of a patch at the end of their range now."""
        return int(self._state[p, SATURATED])

    def rezero(self, p: int) -> None:
        """What a patch reads now is rest."""
        self.catch_up()
        self.sync(p)
        self.conditioners[p].rezero()
        if self.takes[p]:
            self._load(p)

    def _load(self, p: int) -> None:
        """Take over what the patch's conditioner has learnt."""
        one = self.conditioners[p]
        self._mask()
        self._held.discard(p)
        self._offset[self.begins[p] : self.begins[p + 1]] = one.offset
        state = self._state[p]
        state[ELAPSED], state[DUE], state[IN_LESSON], state[BENT] = one.lesson
        state[LEAST] = one.settings.baseline.frames
        (self._still.add if one.still else self._still.discard)(p)
        self.limit(p)

    def limit(self, p: int) -> None:
        """Find what is felt anew, from what a patch's conditioner has learnt."""
        one = self.conditioners[p]
        if not set_limits(
            p, self._table, self._sensor, self._offset, one.threshold, one.silent, self._octets, self._blocks
        ):
            self.retire(p)  # a taxel that feels something whatever it reads

    def _revive(self, patches: list[int]) -> None:
        for p in patches:
            first, size = BLOCK * self._table[p, FIRST], self._table[p, TAXELS]
            changed = self._octets[CHANGES, first : first + size] > 0
            self.conditioners[p].revive(changed | (self.conditioners[p].memory[CHANGED] > 0.0))
            self._mask()
            self.limit(p)

    def _mask(self) -> None:
        masks = tuple([one.masked for one in self.conditioners])
        if not all(map(is_, masks, self.masks)):
            self.masks = masks


def _end(one: Conditioner) -> int | None:
    """The largest turned byte that is not at the end of the range; None where frames can't come this way: a
    sensor with three axes, a smoothed response, or one all of whose bytes are its end."""
    if one.patch.sensor.axes == AXES or one.settings.latency > 0.0:
        return None
    raw = _BYTES if one.sign > 0 else _BYTES[::-1]
    signal = one.sensor[SIGN] * (raw - one.sensor[REST])
    below = int(np.count_nonzero(signal < one.sensor[FULL]))
    return below - 1 if below else None
