"""Connections to a simulated robot, a recorded robot, or a robot on a middleware (layer L2 in Fig. 2 of the
paper). Each connection is a `Driver` (module `driver`), which reads the robot's sensors and sends the
commands that the driver's gate approved. Servers let other programs read and command a robot, and the package
`faults` injects faults into any driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.drivers.combined import CombinedDriver as CombinedDriver
    from tci.drivers.diagnosis import Finding as Finding
    from tci.drivers.diagnosis import Level as Level
    from tci.drivers.driver import Driver as Driver
    from tci.drivers.driver import NativePart as NativePart
    from tci.drivers.info import DriverInfo as DriverInfo
    from tci.drivers.registry import connect as connect
    from tci.drivers.registry import driver_names as driver_names
    from tci.drivers.registry import open_server as open_server
    from tci.drivers.registry import server_names as server_names
    from tci.drivers.registry import source_names as source_names
    from tci.drivers.replay import ReplayDriver as ReplayDriver
    from tci.drivers.server import Server as Server
    from tci.drivers.simulated import SimulatedDriver as SimulatedDriver
    from tci.drivers.source import FingerAngles as FingerAngles
    from tci.drivers.source import Sample as Sample
    from tci.drivers.source import Source as Source
    from tci.drivers.sourced import SourcedDriver as SourcedDriver
    from tci.drivers.wrapper import DriverWrapper as DriverWrapper
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
