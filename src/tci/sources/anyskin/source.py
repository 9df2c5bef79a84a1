"""`anyskin:/dev/ttyACM0`: the magnetic field at each chip of an AnySkin or ReSkin, without its temperatures.

A frame is temperature [degrees C] and field along x, y, z for each chip, as little-endian float32, then CR LF
(PyPI anyskin 1.0.0). There is no first mark, and a float may hold CR LF, so a frame counts between two ends
of a line if its temperatures can be. The field is signed, in microtesla by the maker's users, and drifts with
the skin and with iron nearby.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tci.drivers.source import Sample
from tci.errors import DriverError
from tci.shared.axes import along, values_per_point
from tci.shared.serial_source import SerialSource

COLDEST, HOTTEST = 1.0, 90.0
"""What the chips may measure [degrees C]. Bytes read at the wrong place are mostly near 0 or huge."""


class AnyskinSource(SerialSource):
    """One pad of `chips` chips: five on an AnySkin, the middle one first."""

    mark = b"\r\n"
    baud = 115_200

    def __init__(self, address: str = "", *, baud: str = "", chips: str = "5", axes: str = "xyz") -> None:
        """
        Args:
            address: The serial port.
            baud: Its speed [1/s].
            chips: Number of chips.
            axes: xyz for three values of each chip, z for the one across the skin.

        Raises DriverError for an option that can't be meant.
        """
        super().__init__(address, baud=baud)
        if not chips.isdecimal() or not 1 <= int(chips) <= 64:
            raise DriverError(f"anyskin:{address},chips={chips}; valid: 1 to 64")
        self._chips, self._axes = int(chips), axes
        self.values_per_point = values_per_point(axes)
        self.pads = {"pad": self._chips * self.values_per_point}

    def measure(self, data: bytes) -> int | None:
        size = 16 * self._chips + len(self.mark)
        if len(data) < size + len(self.mark):
            return None
        heat = self._floats(data)[:, 0]
        sure = data[size:].startswith(self.mark) and ((heat > COLDEST) & (heat < HOTTEST)).all()
        return size if sure else 0

    def samples(self, frame: bytes) -> Iterator[Sample]:
        yield Sample("pad", along(self._floats(frame)[:, 1:], self._axes))

    def _floats(self, frame: bytes) -> np.ndarray:
        return np.frombuffer(frame, "<f4", 4 * self._chips, len(self.mark)).reshape(-1, 4)
