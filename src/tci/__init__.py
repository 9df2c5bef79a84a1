"""TCI, the Tactile Capabilities Interface: write a touch behaviour once, run it on any humanoid.

Programs need only the names below. Each name is loaded when a program first uses it. So `import tci` takes no
longer than `import numpy`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tci.body.generic_body import BodySettings as BodySettings
    from tci.body.generic_body import GenericBody as GenericBody
    from tci.body.perceiver import Perceiver as Perceiver
    from tci.body.tactile import ContactShape as ContactShape
    from tci.body.tactile import PressureImage as PressureImage
    from tci.body.tactile import ShearForce as ShearForce
    from tci.body.tactile import TouchEvent as TouchEvent
    from tci.body.tactile import contact_shape as contact_shape
    from tci.body.tactile import pressure_image as pressure_image
    from tci.body.tactile import shear_force as shear_force
    from tci.body.tactile import touch_events as touch_events
    from tci.capabilities.behaviour_tree import BehaviourTree as BehaviourTree
    from tci.capabilities.behaviour_tree import Reflex as Reflex
    from tci.capabilities.behaviour_tree import Task as Task
    from tci.capabilities.body_withdrawal import BodyWithdrawal as BodyWithdrawal
    from tci.capabilities.capability import Capability as Capability
    from tci.capabilities.contact_stop import ContactStop as ContactStop
    from tci.capabilities.fields import ReceptiveField as ReceptiveField
    from tci.capabilities.fields import default_fields as default_fields
    from tci.capabilities.fields import load_fields as load_fields
    from tci.capabilities.light_grasp import LightGrasp as LightGrasp
    from tci.capabilities.play_gesture import PlayGesture as PlayGesture
    from tci.capabilities.soft_reaction import SoftReaction as SoftReaction
    from tci.capabilities.withdrawal import WithdrawalReflex as WithdrawalReflex
    from tci.drivers.driver import Driver as Driver
    from tci.drivers.info import DriverInfo as DriverInfo
    from tci.drivers.registry import connect as connect
    from tci.drivers.registry import driver_names as driver_names
    from tci.drivers.wrapper import DriverWrapper as DriverWrapper
    from tci.errors import ClashError as ClashError
    from tci.errors import CommandError as CommandError
    from tci.errors import DescriptionError as DescriptionError
    from tci.errors import DriverError as DriverError
    from tci.errors import Fault as Fault
    from tci.errors import FrameError as FrameError
    from tci.errors import MissingExtraError as MissingExtraError
    from tci.errors import RecordingError as RecordingError
    from tci.errors import TciError as TciError
    from tci.errors import UnknownNameError as UnknownNameError
    from tci.errors import WireError as WireError
    from tci.exports.facts import query as query
    from tci.exports.urdf import to_urdf as to_urdf
    from tci.gate.gate import Gate as Gate
    from tci.gate.gate import SafeCommand as SafeCommand
    from tci.gestures.files import read_csv as read_csv
    from tci.gestures.gesture import Gesture as Gesture
    from tci.gestures.gesture import fit as fit
    from tci.messages import CartesianCommand as CartesianCommand
    from tci.messages import Contact as Contact
    from tci.messages import Contacts as Contacts
    from tci.messages import GenericCommand as GenericCommand
    from tci.messages import JointReading as JointReading
    from tci.messages import Landmark as Landmark
    from tci.messages import LimbPlace as LimbPlace
    from tci.messages import Mode as Mode
    from tci.messages import Perception as Perception
    from tci.messages import PlatformCommand as PlatformCommand
    from tci.messages import PlatformSwitch as PlatformSwitch
    from tci.messages import Reading as Reading
    from tci.messages import SkinFrame as SkinFrame
    from tci.messages import SkinState as SkinState
    from tci.messages import Support as Support
    from tci.messages import SwitchMode as SwitchMode
    from tci.messages.clock import ManualClock as ManualClock
    from tci.messages.clock import MonotonicClock as MonotonicClock
    from tci.messages.clock import ticks as ticks
    from tci.reasons import Code as Code
    from tci.reasons import Notice as Notice
    from tci.reasons import Reason as Reason
    from tci.recording.export import tables as tables
    from tci.recording.perceived import recorded_robot as recorded_robot
    from tci.recording.recorder import Recorder as Recorder
    from tci.recording.recording import Recording as Recording
    from tci.robot.catalogue import load_robot as load_robot
    from tci.robot.catalogue import robot_names as robot_names
    from tci.robot.description import Robot as Robot
    from tci.robot.joint_map import initial_position as initial_position
    from tci.robot.kinematics import KinematicChain as KinematicChain
    from tci.runtime.loop import Tick as Tick
    from tci.runtime.loop import run as run
    from tci.runtime.real_time import real_time as real_time
    from tci.runtime.result import RunResult as RunResult
    from tci.simulation.world import World as World
    from tci.skin.conditioning import ConditioningSettings as ConditioningSettings
    from tci.skin.contacts import ContactSettings as ContactSettings
    from tci.testing import TouchedRobot as TouchedRobot

__version__ = "0.1.0"

_NAMES = {
    "tci.body.generic_body": (
        "BodySettings",
        "GenericBody",
    ),
    "tci.body.perceiver": ("Perceiver",),
    "tci.body.tactile": (
        "ContactShape",
        "PressureImage",
        "ShearForce",
        "TouchEvent",
        "contact_shape",
        "pressure_image",
        "shear_force",
        "touch_events",
    ),
    "tci.capabilities.behaviour_tree": (
        "BehaviourTree",
        "Reflex",
        "Task",
    ),
    "tci.capabilities.body_withdrawal": ("BodyWithdrawal",),
    "tci.capabilities.capability": ("Capability",),
    "tci.capabilities.contact_stop": ("ContactStop",),
    "tci.capabilities.fields": (
        "ReceptiveField",
        "default_fields",
        "load_fields",
    ),
    "tci.capabilities.light_grasp": ("LightGrasp",),
    "tci.capabilities.play_gesture": ("PlayGesture",),
    "tci.capabilities.soft_reaction": ("SoftReaction",),
    "tci.capabilities.withdrawal": ("WithdrawalReflex",),
    "tci.messages.clock": (
        "ManualClock",
        "MonotonicClock",
        "ticks",
    ),
    "tci.drivers.driver": ("Driver",),
    "tci.drivers.info": ("DriverInfo",),
    "tci.drivers.registry": (
        "connect",
        "driver_names",
    ),
    "tci.drivers.wrapper": ("DriverWrapper",),
    "tci.errors": (
        "ClashError",
        "CommandError",
        "DescriptionError",
        "DriverError",
        "Fault",
        "FrameError",
        "MissingExtraError",
        "RecordingError",
        "TciError",
        "UnknownNameError",
        "WireError",
    ),
    "tci.exports.facts": ("query",),
    "tci.exports.urdf": ("to_urdf",),
    "tci.gate.gate": (
        "Gate",
        "SafeCommand",
    ),
    "tci.gestures.files": ("read_csv",),
    "tci.gestures.gesture": (
        "Gesture",
        "fit",
    ),
    "tci.messages": (
        "CartesianCommand",
        "Contact",
        "Contacts",
        "GenericCommand",
        "JointReading",
        "Landmark",
        "LimbPlace",
        "Mode",
        "Perception",
        "PlatformCommand",
        "PlatformSwitch",
        "Reading",
        "SkinFrame",
        "SkinState",
        "Support",
        "SwitchMode",
    ),
    "tci.reasons": (
        "Code",
        "Notice",
        "Reason",
    ),
    "tci.recording.export": ("tables",),
    "tci.recording.perceived": ("recorded_robot",),
    "tci.recording.recorder": ("Recorder",),
    "tci.recording.recording": ("Recording",),
    "tci.robot.catalogue": (
        "load_robot",
        "robot_names",
    ),
    "tci.robot.description": ("Robot",),
    "tci.robot.joint_map": ("initial_position",),
    "tci.robot.kinematics": ("KinematicChain",),
    "tci.runtime.loop": (
        "Tick",
        "run",
    ),
    "tci.runtime.real_time": ("real_time",),
    "tci.runtime.result": ("RunResult",),
    "tci.simulation.world": ("World",),
    "tci.skin.conditioning": ("ConditioningSettings",),
    "tci.skin.contacts": ("ContactSettings",),
    "tci.testing": ("TouchedRobot",),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}
_EXTRAS = {"tci.capabilities.behaviour_tree": "py_trees"}
"""Packages that some modules need in addition, by module. Extras of TCI install these packages."""


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'tci' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Lists only the names that can be loaded, because `help`, `inspect` and editors load each name in this
    list."""
    absent = {module for module, package in _EXTRAS.items() if find_spec(package) is None}
    return sorted([*(name for name, module in _HOME.items() if module not in absent), "__version__"])
