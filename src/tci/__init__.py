"""TCI, the Tactile Capabilities Interface: write a touch behaviour once, run it on any humanoid.

The names below are all a program needs; each is loaded when it is first used, so that
`import tci` costs no more than NumPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tci.capabilities.capability import Capability
    from tci.capabilities.withdrawal import WithdrawalReflex
    from tci.clock import ManualClock, MonotonicClock, ticks
    from tci.errors import TciError
    from tci.interface.body import Body
    from tci.interface.contacts import find_contacts
    from tci.interface.gate import Gate, SafeCommand
    from tci.interface.part import generic_posture, home, to_platform
    from tci.interface.skin import Skin
    from tci.messages import (
        Contact,
        GenericCommand,
        JointReading,
        Mode,
        Perception,
        PlatformCommand,
        Reading,
        SkinFrame,
    )
    from tci.middleware.link import Link
    from tci.model.catalogue import load_robot, robot_names
    from tci.model.description import Robot
    from tci.runtime.loop import Tick, run
    from tci.runtime.registry import connect, link_names

__version__ = "0.1.0"

_HOME = {
    "Body": "tci.interface.body",
    "Capability": "tci.capabilities.capability",
    "Contact": "tci.messages",
    "Gate": "tci.interface.gate",
    "GenericCommand": "tci.messages",
    "JointReading": "tci.messages",
    "Link": "tci.middleware.link",
    "ManualClock": "tci.clock",
    "Mode": "tci.messages",
    "MonotonicClock": "tci.clock",
    "Perception": "tci.messages",
    "PlatformCommand": "tci.messages",
    "Reading": "tci.messages",
    "Robot": "tci.model.description",
    "SafeCommand": "tci.interface.gate",
    "Skin": "tci.interface.skin",
    "SkinFrame": "tci.messages",
    "TciError": "tci.errors",
    "Tick": "tci.runtime.loop",
    "WithdrawalReflex": "tci.capabilities.withdrawal",
    "connect": "tci.runtime.registry",
    "find_contacts": "tci.interface.contacts",
    "generic_posture": "tci.interface.part",
    "home": "tci.interface.part",
    "link_names": "tci.runtime.registry",
    "load_robot": "tci.model.catalogue",
    "robot_names": "tci.model.catalogue",
    "run": "tci.runtime.loop",
    "ticks": "tci.clock",
    "to_platform": "tci.interface.part",
}

__all__ = [
    "Body",
    "Capability",
    "Contact",
    "Gate",
    "GenericCommand",
    "JointReading",
    "Link",
    "ManualClock",
    "Mode",
    "MonotonicClock",
    "Perception",
    "PlatformCommand",
    "Reading",
    "Robot",
    "SafeCommand",
    "Skin",
    "SkinFrame",
    "TciError",
    "Tick",
    "WithdrawalReflex",
    "__version__",
    "connect",
    "find_contacts",
    "generic_posture",
    "home",
    "link_names",
    "load_robot",
    "robot_names",
    "run",
    "ticks",
    "to_platform",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tci' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
