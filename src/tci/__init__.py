"""TCI, the Tactile Capabilities Interface: write a touch behaviour once, run it on any humanoid.

The names below are all a program needs; each is loaded when it is first used, so that
`import tci` costs no more than NumPy.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tci.learning.registration import register_when_imported as _register_when_imported

if TYPE_CHECKING:
    from tci.body.generic_body import BodySettings as BodySettings
    from tci.body.generic_body import GenericBody as GenericBody
    from tci.body.perceiver import Perceiver as Perceiver
    from tci.capabilities.capability import Capability as Capability
    from tci.capabilities.withdrawal import WithdrawalReflex as WithdrawalReflex
    from tci.clock import ManualClock as ManualClock
    from tci.clock import MonotonicClock as MonotonicClock
    from tci.clock import ticks as ticks
    from tci.drivers.driver import Driver as Driver
    from tci.drivers.info import DriverInfo as DriverInfo
    from tci.drivers.registry import connect as connect
    from tci.drivers.registry import driver_names as driver_names
    from tci.drivers.wrapper import DriverWrapper as DriverWrapper
    from tci.errors import TciError as TciError
    from tci.gate.gate import Gate as Gate
    from tci.gate.gate import SafeCommand as SafeCommand
    from tci.learning.simulate import simulate as simulate
    from tci.messages import Contact as Contact
    from tci.messages import GenericCommand as GenericCommand
    from tci.messages import JointReading as JointReading
    from tci.messages import Mode as Mode
    from tci.messages import Perception as Perception
    from tci.messages import PlatformCommand as PlatformCommand
    from tci.messages import Reading as Reading
    from tci.messages import SkinFrame as SkinFrame
    from tci.messages import SwitchMode as SwitchMode
    from tci.reasons import Code as Code
    from tci.reasons import Notice as Notice
    from tci.reasons import Reason as Reason
    from tci.robot.catalogue import load_robot as load_robot
    from tci.robot.catalogue import robot_names as robot_names
    from tci.robot.description import Robot as Robot
    from tci.robot.joint_map import initial_position as initial_position
    from tci.runtime.loop import Tick as Tick
    from tci.runtime.loop import run as run
    from tci.runtime.result import RunResult as RunResult

__version__ = "0.1.0"

_NAMES = {
    "tci.capabilities.capability": ("Capability",),
    "tci.capabilities.withdrawal": ("WithdrawalReflex",),
    "tci.clock": ("ManualClock", "MonotonicClock", "ticks"),
    "tci.errors": ("TciError",),
    "tci.body.generic_body": ("BodySettings", "GenericBody"),
    "tci.body.perceiver": ("Perceiver",),
    "tci.gate.gate": ("Gate", "SafeCommand"),
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
    "tci.drivers.driver": ("Driver",),
    "tci.drivers.info": ("DriverInfo",),
    "tci.drivers.wrapper": ("DriverWrapper",),
    "tci.robot.catalogue": ("load_robot", "robot_names"),
    "tci.robot.description": ("Robot",),
    "tci.robot.joint_map": ("initial_position",),
    "tci.runtime.loop": ("Tick", "run"),
    "tci.reasons": ("Code", "Notice", "Reason"),
    "tci.drivers.registry": ("connect", "driver_names"),
    "tci.runtime.result": ("RunResult",),
    "tci.learning.simulate": ("simulate",),
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
