"""`flexitac:/dev/ttyUSB0`: the raw counts of a FlexiTac pad, row by row.

A frame is AA 55 and one byte for each taxel, without a checksum (firmware in PyPI flexitac 0.3.1). Two
neighbouring values can look like the mark, so a frame counts when the mark of the next one is behind it: one
period, about 10 ms, late. At rest a count is 10 to 40; 0 or 255 everywhere is a broken wire.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from tci.drivers.source import Sample
from tci.shared.serial_source import SerialSource

TAXELS = 12 * 32


class FlexitacSource(SerialSource):
    """One pad."""

    pads: Mapping[str, int] = {"pad": TAXELS}
    device = "flexitac"
    mark = b"\xaa\x55"
    baud = 2_000_000

    def measure(self, data: bytes) -> int | None:
        size = len(self.mark) + TAXELS
        if len(data) < size + len(self.mark):
            return None
        return size if data[size:].startswith(self.mark) else 0

    def samples(self, frame: bytes) -> Iterator[Sample]:
        yield Sample("pad", np.frombuffer(frame, np.uint8, offset=len(self.mark)))
