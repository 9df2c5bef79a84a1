"""What patches feel, by the taxels that feel something; a `PatchState` is made when one is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.messages import PatchState, SkinFrame

Pressed = tuple[NDArray[np.int32], Array, NDArray[np.int64]]
"""Taxels (m,) that feel something, patch by patch, the pressure (m,) [Pa] on them, and where each patch's
begin (p + 1,)."""
NOBODY: Pressed = np.zeros(0, np.int32), np.zeros(0), np.zeros(0, np.int64)


class FeltPatches(Mapping[str, PatchState]):
    """The state of each patch that has sent a frame, by name."""

    __slots__ = ("_areas", "_made", "_places", "_pressed", "frames", "masks", "others")

    def __init__(
        self,
        places: Mapping[str, int],
        areas: Mapping[str, Array],
        frames: Mapping[str, SkinFrame],
        masks: tuple[NDArray[np.bool_], ...],
        pressed: Pressed,
        others: Mapping[str, PatchState],
    ) -> None:
        """`places` of all patches of the skin, and `areas` (n,) [m2] of their taxels; `others` are the states
        that were worked out for all taxels."""
        self._places, self._areas, self._pressed = places, areas, pressed
        self._made: dict[str, PatchState] = {}
        self.frames = frames
        """The frame of each patch that it was made from."""
        self.masks = masks
        """Which taxels (n,) of each patch (p,) are ignored."""
        self.others = others

    @property
    def untouched(self) -> bool:
        """Whether no taxel feels anything, as far as is known without looking at `others`."""
        return not len(self._pressed[0]) and not self.others

    def __getitem__(self, patch: str) -> PatchState:
        state = self.others.get(patch) or self._made.get(patch)
        if state is None:
            state = self._made[patch] = self._make(self.frames[patch])
        return state

    def __iter__(self) -> Iterator[str]:
        return iter(self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    def __contains__(self, patch: object) -> bool:
        return patch in self.frames

    def _make(self, frame: SkinFrame) -> PatchState:
        place, areas = self._places[frame.patch], self._areas[frame.patch]
        taxels, pressures, begins = self._pressed
        own = slice(begins[place], begins[place + 1])
        pressure = np.zeros(len(areas))
        pressure[taxels[own]] = pressures[own]
        force = pressure * areas
        pressure.setflags(write=False)
        force.setflags(write=False)
        return PatchState(frame.patch, frame.stamp, frame.sequence, pressure, force, masked=self.masks[place])
