"""All messages between layers: frozen, with read-only arrays, in SI units and radians; and clocks.

Data flows one way (docs/architecture.md):

    Reading(JointReading, SkinFrame...)   robot -> interface       raw, in the robot's own order
    SkinState                             skin                     pressure [Pa] of the active taxels
    Contacts                              skin/contacts            eq. 7
    Perception                            interface -> capability  generic posture and contacts
    GenericCommand, SwitchMode            capability -> interface  generic joints, tagged with its mode
    PlatformCommand, PlatformSwitch       body/posture             inverse of eqs 1-2, mapped servos only
    SafeCommand                           gate                     all that a driver writes
"""

from __future__ import annotations

from tci.messages.clock import Clock, ManualClock, MonotonicClock, ticks
from tci.messages.commands import (
    CartesianCommand,
    Command,
    ExpectContact,
    GenericCommand,
    Order,
    PlatformCommand,
    PlatformOrder,
    PlatformSwitch,
    SwitchMode,
)
from tci.messages.contact_history import ContactHistory, ContactPath
from tci.messages.contacts import Contact, Contacts, Site
from tci.messages.met import Answer, Met
from tci.messages.modes import CONTROL_MODES, Mode, ModeLike
from tci.messages.perception import Perception, SkinState, Support
from tci.messages.places import Landmark, LimbPlace
from tci.messages.readings import JointReading, Reading, SkinFrame

__all__ = [
    "CONTROL_MODES",
    "Answer",
    "CartesianCommand",
    "Clock",
    "Command",
    "Contact",
    "ContactHistory",
    "ContactPath",
    "Contacts",
    "ExpectContact",
    "GenericCommand",
    "JointReading",
    "Landmark",
    "LimbPlace",
    "ManualClock",
    "Met",
    "Mode",
    "ModeLike",
    "MonotonicClock",
    "Order",
    "Perception",
    "PlatformCommand",
    "PlatformOrder",
    "PlatformSwitch",
    "Reading",
    "Site",
    "SkinFrame",
    "SkinState",
    "Support",
    "SwitchMode",
    "ticks",
]
