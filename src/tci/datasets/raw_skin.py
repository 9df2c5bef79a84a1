"""Raw skin frames from the columns of a set that TCI wrote."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tci.datasets.episodes import COUNT, RAW, STAMPS, Columns
from tci.messages import SkinFrame


def skin_frames(columns: Columns) -> Iterator[tuple[SkinFrame, ...]]:
    """Yields the frames of an episode, bit for bit, in the order of their times; nothing if it has none."""
    patches = [name.removeprefix(f"{RAW}.") for name in columns if name.startswith(f"{RAW}.")]
    found: list[SkinFrame] = []
    for patch in patches:
        raw, stamps = columns[f"{RAW}.{patch}"], columns[f"{STAMPS}.{patch}"]
        counts = columns[f"{COUNT}.{patch}"].ravel()
        slots = stamps.shape[1]
        there = np.arange(slots) < counts[:, None]
        values = raw.reshape(len(raw), slots, -1)[there]
        found += [
            SkinFrame(patch, stamp / 1e9, sequence, one)
            for sequence, (stamp, one) in enumerate(zip(stamps[there].tolist(), values, strict=True))
        ]
    found.sort(key=lambda frame: frame.stamp)
    together: list[SkinFrame] = []
    for frame in found:
        if together and frame.stamp > together[0].stamp:
            yield tuple(together)
            together = []
        together.append(frame)
    if together:
        yield tuple(together)
