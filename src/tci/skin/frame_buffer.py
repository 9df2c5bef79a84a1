"""Raw values of all patches in one array. New frames replace the values of their patches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tci.errors import FrameError
from tci.skin.kernels.arrays import Places
from tci.skin.layout import SkinLayout

SETS = 16
"""Largest number of cached entries, one for each combination of patches whose frames arrive together.
Assumed: fewer combinations occur, because patches with equal frame rates send together."""
Values = Sequence[NDArray[np.generic]]


class FrameBuffer:
    """Raw values of all patches of a skin. Checks that frames fit their patches."""

    def __init__(self, layout: SkinLayout) -> None:
        self._layout = layout
        size = layout.channels[-1].stop if layout.patches else 0
        self.raw: NDArray[np.generic] = np.zeros(size, layout.dtype)
        """Raw values (channels,) of the latest frames."""
        self.last = self.raw.copy()
        """Raw values (channels,) of the previous frames."""
        self.names: tuple[str, ...] = ()
        """Names (k,) of the patches in the latest call of `arrange`."""
        self.which: Places = np.zeros(0, np.int64)
        """Index (k,) of each patch of `names` in the layout's list of patches."""
        self.order: list[int] = []
        """`which` as a list."""
        self.whole = False
        """True if the latest call of `arrange` contained all patches, in the order of the layout."""
        self._sizes = list[tuple[int]]()
        self._accepted = {self.raw.dtype}
        self._arranged: dict[tuple[str, ...], tuple[Places, list[tuple[int]], bool]] = {}

    def arrange(self, names: tuple[str, ...]) -> None:
        """Prepares for frames of the patches `names`. Raises FrameError for an unknown patch.

        The result is cached, since few combinations of patches occur: slow patches send together with every
        n-th frame of fast patches.
        """
        if names == self.names:
            return
        places = self._layout.places
        found = self._arranged.get(names)
        if found is None:
            for name in names:
                if name not in places:
                    raise FrameError(f"no skin patch {name!r}; valid: {', '.join(places) or '(none)'}")
            which = [places[name] for name in names]
            sizes = [(self._layout.patches[p].description.channels,) for p in which]
            if len(self._arranged) >= SETS:
                self._arranged.clear()
            found = self._arranged[names] = np.array(which, np.int64), sizes, which == [*range(len(places))]
        self.which, self._sizes, self.whole = found
        self.order = self.which.tolist()
        self.names = names

    def check(self, values: Values) -> None:
        """Raises FrameError unless all `values` (channels,) fit the patches given to `arrange`.

        Switches the buffer to float32 if the dtype of the values requires float32.
        """
        if [one.shape for one in values] != self._sizes:
            for name, one, size in zip(self.names, values, self._sizes, strict=True):
                if one.shape != size:
                    raise FrameError(
                        f"{name}: frame of shape {one.shape}, expected {size}, one value per channel"
                    )
        own, others = self.raw.dtype, {one.dtype for one in values}
        if others <= self._accepted:
            return
        if any(other.kind not in "uif" for other in others):
            for name, one in zip(self.names, values, strict=True):
                if one.dtype.kind not in "uif":
                    raise FrameError(
                        f"{name}: frame of type {one.dtype}, expected integers or floating point numbers"
                    )
        if own != np.float32 and not all(np.can_cast(other, own) for other in others):
            self.raw, self.last = self.raw.astype(np.float32), self.last.astype(np.float32)
        self._accepted |= others

    def fill(self, values: Values) -> None:
        """Copies `values`, which `check` has accepted, into `raw`."""
        if self.raw.dtype != np.float32:
            self._copy(values)
        else:  # NaN and numbers that are too large become values outside every sensor's range
            with np.errstate(invalid="ignore", over="ignore"):
                self._copy(values)

    def _copy(self, values: Values) -> None:
        if self.whole:
            np.concatenate(values, out=self.raw, casting="unsafe")
        else:
            for p, one in zip(self.order, values, strict=True):
                self.raw[self._layout.channels[p]] = one
