"""The safety filter (the gate) between commands and a robot: the gate passes nothing that violates a limit.

The gate converts each command to a jerk-limited motion from which the robot can stop at any time, and stops
the robot if data is late, lost or wrong. Only a gate creates the `SafeCommand` that a driver writes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.gate.commanded_groups import WayBack as WayBack
    from tci.gate.contact.settings import ContactSettings as ContactSettings
    from tci.gate.gate import Gate as Gate
    from tci.gate.joint_monitor import MonitorSettings as MonitorSettings
    from tci.gate.safe_command import GateState as GateState
    from tci.gate.safe_command import SafeCommand as SafeCommand
    from tci.gate.settings import GateCounts as GateCounts
    from tci.gate.settings import GateSettings as GateSettings
    from tci.robot.clearance import Fixture as Fixture
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
