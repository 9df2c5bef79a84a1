"""A skin frame as sensor_msgs/PointCloud2: one point per channel, in the coordinates of the patch's link."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.messages import SkinFrame
from tci.recording.schemas import FORMATS, header
from tci.robot.description import Patch
from tci.skin.surfaces import Surface

DATATYPES = {name: number for number, name in FORMATS.items()}
FLOAT32 = DATATYPES["f4"]


class PatchCloud:
    """Points of one patch: x, y, z [m], pressure [Pa] and the raw value of each channel.

    The pressure is computed with the calibration in the robot's description. A channel that is no taxel also
    has a point, with NaN as position. Therefore the message's field `raw` contains all values of the skin
    frame, in the order of the channels.
    """

    def __init__(self, patch: Patch, surface: Surface) -> None:
        self._patch = patch
        self._places = np.full((patch.channels, 3), np.nan, dtype=np.float32)
        self._places[surface.channels] = surface.positions

    def values(self, frame: SkinFrame, stamp: float) -> tuple[Any, ...]:
        """Returns the values of the PointCloud2 message for a skin frame, with the time stamp `stamp` [s]."""
        raw: NDArray[Any] = frame.values
        kind = raw.dtype.str[1:]
        if kind not in DATATYPES:  # 8-byte integers, which PointField lacks
            raw, kind = raw.astype(np.float64), "f8"
        sensor = self._patch.sensor
        layout = np.dtype([("place", "<f4", 3), ("pressure", "<f4"), ("raw", f"<{kind}")])
        points = np.zeros(len(raw), dtype=layout)
        places = self._places[: len(raw)]
        points["place"] = np.nan
        points["place"][: len(places)] = places
        points["pressure"] = sensor.pressure((raw - sensor.rest) * np.sign(sensor.pascal_per_count))
        points["raw"] = raw
        names = [(name, 4 * place, FLOAT32, 1) for place, name in enumerate(("x", "y", "z", "pressure"))]
        fields = [*names, ("raw", 16, DATATYPES[kind], 1)]
        data = np.frombuffer(points.tobytes(), dtype=np.uint8)
        head = header(stamp, self._patch.link)
        return *head, 1, len(raw), fields, False, layout.itemsize, len(data), data, False
