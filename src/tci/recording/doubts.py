"""What imported touch can hardly mean: padding, pads that never sent, one pad of two."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.messages import SkinFrame


@dataclass(slots=True)
class _Seen:
    frames: int = 0
    without: int = 0
    """Frames in which a value is missing."""
    least: float = np.inf
    most: float = -np.inf

    @property
    def silent(self) -> bool:
        return self.least >= self.most == 0.0 or self.most == -np.inf


class Streams:
    """Watches the streams of touch of an import."""

    def __init__(self, *, chosen: bool = False) -> None:
        """`chosen` says that somebody chose what is read: then one side alone is meant."""
        self._chosen = chosen
        self._padding: list[str] = []
        self._seen: dict[str, _Seen] = {}

    def see(self, name: str, values: NDArray[Any]) -> NDArray[Any]:
        """Looks at all values (frames, n) of a stream. Returns them without columns that are padding."""
        if values.dtype.kind == "f":
            padding = np.isnan(values).all(axis=0)
            if padding.any():
                self._padding.append(
                    f"{name}: {int(padding.sum())} of {len(padding)} values are NaN in all frames: padding, "
                    "left out"
                )
                values = values[:, ~padding]
        self._look(name, values)
        return values

    def watch(self, items: Iterable[tuple[SkinFrame, ...]]) -> Iterator[tuple[SkinFrame, ...]]:
        """Looks at frames that pass by."""
        for item in items:
            for frame in item:
                if frame.values.dtype.kind in "biuf":
                    self._look(frame.patch, frame.values[None])
            yield item

    def doubts(self) -> tuple[str, ...]:
        """What was found, a sentence each; also of pairs of which one side is alone."""
        said = [*self._padding]
        for name, seen in self._seen.items():
            if seen.without:
                said.append(f"{name}: values are NaN in {seen.without} of {seen.frames} frames")
            if seen.least == seen.most and (seen.frames > 1 or seen.most == 0.0):
                said.append(f"{name}: {seen.most:g} in all {seen.frames} frames; was it connected?")
        for name, seen in self._seen.items():
            side = "left" if name.startswith("left") else "right" if name.startswith("right") else ""
            if not side or seen.silent:
                continue
            other = f"{'right' if side == 'left' else 'left'}{name.removeprefix(side)}"
            there = other in self._seen
            if self._seen[other].silent if there else not self._chosen:
                state = "has no value but 0" if there else "is missing"
                said.append(f"{name} has touch, {other} {state}: one of two pads")
        return tuple(said)

    def _look(self, name: str, values: NDArray[Any]) -> None:
        seen = self._seen.setdefault(name, _Seen())
        seen.frames += len(values)
        if values.dtype.kind == "f":
            missing = np.isnan(values)
            if missing.any():
                seen.without += int(missing.any(axis=1).sum())
                values = values[~missing]
        if values.size:
            seen.least = min(seen.least, float(values.min()))
            seen.most = max(seen.most, float(values.max()))
