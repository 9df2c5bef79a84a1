"""What imported touch can hardly mean: padding, pads that never sent, one pad of two."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Streams:
    """Watches the streams of touch of an import, whole episodes at a time."""

    def __init__(self) -> None:
        self._said: list[str] = []
        self._silent: dict[str, bool] = {}

    def see(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """Looks at the values (frames, n) of a stream. Returns them without columns that are padding."""
        frames, size = values.shape
        missing = np.isnan(values) if values.dtype.kind == "f" else np.zeros(values.shape, np.bool_)
        padding = missing.all(axis=0)
        if padding.any():
            many = int(padding.sum())
            self._said.append(f"{name}: {many} of {size} values are NaN in all frames: padding, left out")
            values, missing = values[:, ~padding], missing[:, ~padding]
        if missing.any():
            many = int(missing.any(axis=1).sum())
            self._said.append(f"{name}: NaN in {many} of {frames} frames; its taxels are without value there")
        there = values[~missing]
        self._silent[name] = not there.size or not there.any()
        if there.size and not there.any():
            self._said.append(f"{name}: 0 in all {frames} frames; was it connected?")
        elif there.size and frames > 1 and there.min() == there.max():
            self._said.append(f"{name}: {there.flat[0]:g} in all {frames} frames; was it connected?")
        return values

    def doubts(self) -> tuple[str, ...]:
        """What was found, a sentence each; also of pairs of which one side is alone."""
        alone = []
        for name, silent in self._silent.items():
            side = "left" if name.startswith("left") else "right" if name.startswith("right") else ""
            if not side or silent:
                continue
            other = f"{'right' if side == 'left' else 'left'}{name.removeprefix(side)}"
            if self._silent.get(other, True):
                state = "has no value but 0" if other in self._silent else "is missing"
                alone.append(f"{name} has touch, {other} {state}: one of two pads")
        return (*self._said, *alone)
