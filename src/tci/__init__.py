"""TCI, the Tactile Capabilities Interface: write a touch behaviour once, run it on any robot with skin.

Most programs need only the names below; `tci.messages`, `tci.body`, `tci.drivers` and other packages have
more (docs/reference.md). Each name is loaded when it is first used, so `import tci` takes no longer than
`import numpy`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.body.generic_body import GenericBody as GenericBody
    from tci.body.perceiver import Perceiver as Perceiver
    from tci.capabilities.arbiter import Arbiter as Arbiter
    from tci.capabilities.attend.capability import Attend as Attend
    from tci.capabilities.body_withdrawal import BodyWithdrawal as BodyWithdrawal
    from tci.capabilities.capability import Capability as Capability
    from tci.capabilities.contact_stop import ContactStop as ContactStop
    from tci.capabilities.finger_reflex.capability import FingerReflex as FingerReflex
    from tci.capabilities.gentle.capability import Gentle as Gentle
    from tci.capabilities.light_grasp import LightGrasp as LightGrasp
    from tci.capabilities.play_gesture import PlayGesture as PlayGesture
    from tci.capabilities.policy.capability import PolicyCapability as PolicyCapability
    from tci.capabilities.soft_reaction import SoftReaction as SoftReaction
    from tci.capabilities.teach.capability import Teach as Teach
    from tci.capabilities.withdrawal import WithdrawalReflex as WithdrawalReflex
    from tci.capabilities.wrapper import CapabilityWrapper as CapabilityWrapper
    from tci.drivers.driver import Driver as Driver
    from tci.drivers.registry import connect as connect
    from tci.errors import ClashError as ClashError
    from tci.errors import CommandError as CommandError
    from tci.errors import DescriptionError as DescriptionError
    from tci.errors import DriverError as DriverError
    from tci.errors import FrameError as FrameError
    from tci.errors import MissingExtraError as MissingExtraError
    from tci.errors import RecordingError as RecordingError
    from tci.errors import TciError as TciError
    from tci.errors import UnknownNameError as UnknownNameError
    from tci.errors import WireError as WireError
    from tci.lab.pictures.film import film as film
    from tci.messages import CartesianCommand as CartesianCommand
    from tci.messages import Contact as Contact
    from tci.messages import Contacts as Contacts
    from tci.messages import ExpectContact as ExpectContact
    from tci.messages import GenericCommand as GenericCommand
    from tci.messages import Mode as Mode
    from tci.messages import Perception as Perception
    from tci.messages import SwitchMode as SwitchMode
    from tci.recording.recorder import Recorder as Recorder
    from tci.recording.recording import Recording as Recording
    from tci.robot.catalogue import load_robot as load_robot
    from tci.robot.catalogue import robot_names as robot_names
    from tci.robot.description import Robot as Robot
    from tci.robot.like import RobotLike as RobotLike
    from tci.runtime.loop import Tick as Tick
    from tci.runtime.loop import run as run
    from tci.runtime.result import RunResult as RunResult
    from tci.runtime.stepper import Stepper as Stepper
    from tci.simulation.world import World as World
    from tci.touches.touch import Touch as Touch
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)

__version__ = "0.1.0"
