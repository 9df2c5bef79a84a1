"""TCI, the Tactile Capabilities Interface: write a touch behaviour once, run it on any humanoid.

The names below are all a program needs; each is loaded when it is first used, so that
`import tci` costs no more than NumPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tci.trials.registration import register_when_imported as _register_when_imported

if TYPE_CHECKING:
    from tci.capabilities.capability import Capability as Capability
    from tci.capabilities.withdrawal import WithdrawalReflex as WithdrawalReflex
    from tci.clock import ManualClock as ManualClock
    from tci.clock import MonotonicClock as MonotonicClock
    from tci.clock import ticks as ticks
    from tci.errors import TciError as TciError
    from tci.interface.body import Body as Body
    from tci.interface.gate.gate import Gate as Gate
    from tci.interface.gate.gate import SafeCommand as SafeCommand
    from tci.interface.part import generic_posture as generic_posture
    from tci.interface.part import home as home
    from tci.interface.part import to_platform as to_platform
    from tci.interface.skin.contacts import find_contacts as find_contacts
    from tci.interface.skin.skin import Skin as Skin
    from tci.messages import Contact as Contact
    from tci.messages import GenericCommand as GenericCommand
    from tci.messages import JointReading as JointReading
    from tci.messages import Mode as Mode
    from tci.messages import Perception as Perception
    from tci.messages import PlatformCommand as PlatformCommand
    from tci.messages import Reading as Reading
    from tci.messages import SkinFrame as SkinFrame
    from tci.messages import SwitchMode as SwitchMode
    from tci.middleware.link import Link as Link
    from tci.model.catalogue import load_robot as load_robot
    from tci.model.catalogue import robot_names as robot_names
    from tci.model.description import Robot as Robot
    from tci.runtime.loop import Tick as Tick
    from tci.runtime.loop import run as run
    from tci.runtime.reasons import Notice as Notice
    from tci.runtime.registry import connect as connect
    from tci.runtime.registry import link_names as link_names
    from tci.runtime.result import RunResult as RunResult
    from tci.trials.simulate import simulate as simulate

__version__ = "0.1.0"

_NAMES = {
    "tci.capabilities.capability": ("Capability",),
    "tci.capabilities.withdrawal": ("WithdrawalReflex",),
    "tci.clock": ("ManualClock", "MonotonicClock", "ticks"),
    "tci.errors": ("TciError",),
    "tci.interface.body": ("Body",),
    "tci.interface.skin.contacts": ("find_contacts",),
    "tci.interface.gate.gate": ("Gate", "SafeCommand"),
    "tci.interface.part": ("generic_posture", "home", "to_platform"),
    "tci.interface.skin.skin": ("Skin",),
    "tci.messages": (
        "Contact",
        "GenericCommand",
        "JointReading",
        "Mode",
        "Perception",
        "PlatformCommand",
        "Reading",
        "SkinFrame",
        "SwitchMode",
    ),
    "tci.middleware.link": ("Link",),
    "tci.model.catalogue": ("load_robot", "robot_names"),
    "tci.model.description": ("Robot",),
    "tci.runtime.loop": ("Tick", "run"),
    "tci.runtime.reasons": ("Notice",),
    "tci.runtime.registry": ("connect", "link_names"),
    "tci.runtime.result": ("RunResult",),
    "tci.trials.simulate": ("simulate",),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tci' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"])


_register_when_imported()
