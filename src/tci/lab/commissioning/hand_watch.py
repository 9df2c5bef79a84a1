"""What a hand feels while somebody does what the doctor asks for."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.drivers.source_reader import SourceReader
from tci.robot.tactile_devices import FINGERS

NOISE = 5.0
"""A change counts from this multiple of the largest change at rest, and from `LEAST` counts."""
LEAST = 3.0
Ask = Callable[[str], str]
"""Shows a person what to do, and returns when it is being done, with what the person typed."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The frames of one pad in a span of time."""

    frames: NDArray[np.float64]
    """(frames, values)."""

    def change(self, rest: Seen) -> NDArray[np.float64]:
        """(values,) largest distance from the median at rest."""
        if not len(self.frames) or not len(rest.frames):
            return np.zeros(self.frames.shape[1])
        found: NDArray[np.float64] = np.abs(self.frames - np.median(rest.frames, axis=0)).max(axis=0)
        return np.nan_to_num(found)


def named(place: str) -> str:
    finger = " finger" * (place in FINGERS[1:])
    return f"the {place.replace('_', ' ')}{finger}"


def watch(reader: SourceReader, seconds: float) -> dict[str, Seen]:
    taken: dict[str, list[NDArray[np.float64]]] = {pad: [] for pad in reader.pads}
    before = {pad: state.sequence for pad, state in reader.pads.items()}
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for pad, state in reader.pads.items():
            if state.sequence != before[pad] and state.values is not None:
                before[pad] = state.sequence
                taken[pad].append(state.values.astype(float))
        time.sleep(0.002)
    return {
        pad: Seen(np.array(frames).reshape(-1, reader.pads[pad].channels)) for pad, frames in taken.items()
    }


def share(change: NDArray[np.float64], rest: Seen) -> float:
    """Largest change, in parts of what counts as one."""
    return float(change.max(initial=0.0) / max(LEAST, NOISE * rest.change(rest).max(initial=0.0)))
