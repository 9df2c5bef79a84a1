"""Recordings as data sets that policies train on.

A recording is an episode; `read_set` turns recordings into columns with one row per frame of the set, and a
module per format writes and reads them (`lerobot`, `open_x_tactile`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.datasets.episodes import DataSet as DataSet
    from tci.datasets.episodes import Episode as Episode
    from tci.datasets.episodes import Feature as Feature
    from tci.datasets.episodes import Pictures as Pictures
    from tci.datasets.episodes import read_set as read_set
    from tci.datasets.lerobot import LeRobotSet as LeRobotSet
    from tci.datasets.lerobot import read_lerobot as read_lerobot
    from tci.datasets.lerobot import write_lerobot as write_lerobot
    from tci.datasets.open_x_tactile import OxtSet as OxtSet
    from tci.datasets.open_x_tactile import read_oxt as read_oxt
    from tci.datasets.open_x_tactile import write_oxt as write_oxt
    from tci.datasets.zarr2 import ZarrArray as ZarrArray
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
