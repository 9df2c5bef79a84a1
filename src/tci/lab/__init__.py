"""Tools around the core: describe a robot, try a real one, experiments, faults, pictures, the viewer.

Programs need only the names below; each is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tci.lab.commissioning.doctor import judge
    from tci.lab.commissioning.streams import observe
    from tci.lab.experiments.follow import follow
    from tci.lab.experiments.simulate import simulate
    from tci.lab.pictures.pressure_png import write_png

__all__ = ["follow", "judge", "observe", "simulate", "write_png"]

_HOME = {
    "follow": "tci.lab.experiments.follow",
    "judge": "tci.lab.commissioning.doctor",
    "observe": "tci.lab.commissioning.streams",
    "simulate": "tci.lab.experiments.simulate",
    "write_png": "tci.lab.pictures.pressure_png",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tci.lab' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
