"""`orca:/dev/ttyUSB0`: the finger tips of an ORCA hand, and the angles of its joints where it sends them.

The board speaks PaXini's protocol. At `baud=2000000` it also sends the encoders of 17 joints, in frames with
AA A9: 14 bits of angle each, a bit for an error and one that makes the number of ones even (PyPI orca-core
0.12.0). Each point measures along its own axes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tci.drivers.source import FingerAngles, Sample
from tci.sources.paxini.board import ANGLES, PaxiniSource

WRONG, TURN = 1 << 14, 1 << 14
"""Bit of an encoder's error; steps of one turn."""


class OrcaSource(PaxiniSource):
    """Five tips, `thumb_tip` to `little_tip`, with 363 points. Angles are 0 to 1 turn, from no known zero."""

    joints = (
        *(f"thumb_{joint}" for joint in ("dip", "mcp", "abd", "cmc")),
        *(f"{finger}_{joint}" for finger in ("index", "middle", "ring", "little")
          for joint in ("pip", "mcp", "abd")),
        "wrist",
    )  # fmt: skip

    def samples(self, frame: bytes) -> Iterator[Sample | FingerAngles]:
        if not frame.startswith(ANGLES):
            yield from super().samples(frame)
        elif len(frame) == 7 + 2 * len(self.joints):
            raw = np.frombuffer(frame, "<u2", len(self.joints), 6)
            fine = (np.bitwise_count(raw) % 2 == 0) & (raw & WRONG == 0)
            found = zip(self.joints, (raw & TURN - 1) / TURN, fine, strict=True)
            yield FingerAngles({joint: float(angle) for joint, angle, good in found if good})
