"""Facts about a connection to a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Self

from tci.clock import Clock
from tci.gate.gate import Gate
from tci.gate.settings import GateSettings
from tci.robot.description import Robot


@dataclass(frozen=True, slots=True, eq=False)
class DriverInfo:
    """Facts about one connection to a robot. A wrapper replaces some of them."""

    robot: Robot
    clock: Clock
    """Clock of all stamps."""
    gate: Gate
    """The gate, which alone makes the commands that the driver writes. Its period is that of the commands."""
    armed: bool
    """True if the driver may write."""
    lease_name: str
    """Name of the lease. Drivers with equal names reach one robot, and only one of them may command it at a
    time."""
    keep_alive: float | None = None
    """Longest time [s] between two frames of a patch if the skin is sent on change (send-on-delta); None if
    every frame is sent."""
    about: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Facts that a recording needs so that its run can be repeated: seed and step of the physics."""
    recorded: bool = False
    """True if the driver replays a recording: writing moves nothing, and each reading is returned once."""
    unreached: Mapping[int, str] = field(default_factory=lambda: MappingProxyType({}))
    """Reason, by servo index, for each servo that the driver reads but can't move."""

    @classmethod
    def of(
        cls,
        robot: Robot,
        middleware: str,
        *,
        clock: Clock,
        armed: bool,
        lease_name: str | None = None,
        settings: GateSettings | None = None,
        period: float | None = None,
        keep_alive: float | None = None,
        about: Mapping[str, str] | None = None,
        recorded: bool = False,
    ) -> Self:
        """Returns the facts of a connection over `middleware`, by the robot's binding to it, with a new gate.

        `settings` are the gate's. By default the binding gives the `period` [s] of the commands, and robot
        and middleware form the `lease_name`.

        Raises UnknownNameError for a robot without a binding to the middleware.
        """
        binding = robot.binding(middleware)
        gate = Gate(
            robot, period=period or 1.0 / binding.rate, stale_after=binding.stale_after, settings=settings
        )
        return cls(
            robot=robot,
            clock=clock,
            gate=gate,
            armed=armed,
            lease_name=lease_name or f"{middleware}:{robot.name}",
            keep_alive=keep_alive,
            about=about or MappingProxyType({}),
            recorded=recorded,
        )
