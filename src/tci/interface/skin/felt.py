"""What patches feel, by the taxels that feel something; a `PatchState` is made when one is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.messages import PatchState

_NOBODY = np.zeros(0, np.int32)


class Felt:
    """One frame of one patch."""

    __slots__ = (
        "_areas", "_begin", "_end", "_pressure", "_state", "_taxels", "masked", "patch", "sequence", "stamp",
        "vector",
    )  # fmt: skip

    def __init__(
        self,
        patch: str,
        stamp: float,
        sequence: int,
        masked: NDArray[np.bool_],
        taxels: NDArray[np.int32],
        pressure: Array,
        begin: int,
        end: int,
        areas: Array,
    ) -> None:
        """Of taxels with `areas` (n,) [m2] some `taxels` (m,) feel a `pressure` (m,) [Pa]: those from place
        `begin` to `end`."""
        self.patch, self.stamp, self.sequence, self.masked = patch, stamp, sequence, masked
        self.vector: Array | None = None
        self._taxels, self._pressure, self._areas = taxels, pressure, areas
        self._begin, self._end = begin, end
        self._state: PatchState | None = None

    @staticmethod
    def of(state: PatchState) -> Felt:
        """What was worked out for all taxels."""
        none = np.zeros(0)
        masked = np.zeros(len(state.force), np.bool_) if state.masked is None else state.masked
        felt = Felt(state.patch, state.stamp, state.sequence, masked, _NOBODY, none, 0, 0, none)
        felt.vector, felt._state = state.vector, state
        return felt

    def again(self, stamp: float, sequence: int, masked: NDArray[np.bool_]) -> Felt:
        """The same in another frame."""
        felt = Felt(
            self.patch,
            stamp,
            sequence,
            masked,
            self._taxels,
            self._pressure,
            self._begin,
            self._end,
            self._areas,
        )
        if self._state is not None:
            old = self._state
            felt._state = PatchState(old.patch, stamp, sequence, old.pressure, old.force, masked=masked)
        return felt

    @property
    def state(self) -> PatchState:
        """For all taxels."""
        if self._state is None:
            pressure = np.zeros(len(self._areas))
            own = slice(self._begin, self._end)
            pressure[self._taxels[own]] = self._pressure[own]
            force = pressure * self._areas
            pressure.setflags(write=False)
            force.setflags(write=False)
            self._state = PatchState(
                self.patch, self.stamp, self.sequence, pressure, force, masked=self.masked
            )
        return self._state


class FeltPatches(Mapping[str, PatchState]):
    """The state of each patch that has sent a frame, by name."""

    __slots__ = ("felt",)

    def __init__(self, felt: Mapping[str, Felt]) -> None:
        self.felt = felt

    def __getitem__(self, patch: str) -> PatchState:
        return self.felt[patch].state

    def __iter__(self) -> Iterator[str]:
        return iter(self.felt)

    def __len__(self) -> int:
        return len(self.felt)

    def __contains__(self, patch: object) -> bool:
        return patch in self.felt


def masks_of(patches: Mapping[str, PatchState]) -> tuple[NDArray[np.bool_] | None, ...]:
    """The masks of patches, in their order."""
    if isinstance(patches, FeltPatches):
        return tuple([felt.masked for felt in patches.felt.values()])
    return tuple(state.masked for state in patches.values())
