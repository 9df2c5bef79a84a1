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
    """Facts about one connection to a robot. A driver that wraps another driver replaces some of these
    facts."""

    robot: Robot
    clock: Clock
    """Clock of all stamps."""
    gate: Gate
    """Safety gate. The driver writes only commands that this gate created. The period of the gate is the time
    between two commands."""
    armed: bool
    """True if the driver may write."""
    lease_name: str
    """Name of the lease, which is the right to command the robot. Drivers with equal lease names reach the
    same robot, and only one of these drivers may command it at a time."""
    keep_alive: float | None = None
    """Longest time [s] between two frames of a patch, if a frame is sent only when its values change. None if
    every frame is sent."""
    about: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Facts that a recording stores so that the run can be repeated: random seed and time step of the
    physics."""
    recorded: bool = False
    """True if the driver replays a recording. Then `write` moves nothing, and `read` returns each reading
    once."""
    unreached: Mapping[int, str] = field(default_factory=lambda: MappingProxyType({}))
    """For each servo that the driver reads but can't move: the reason, by servo index."""

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
        """Returns the facts about a connection over `middleware`, with a new gate.

        `settings` are the settings of the gate. By default, the `period` [s] of the commands comes from the
        robot's binding (its settings for this middleware), and the `lease_name` consists of middleware and
        robot.

        Raises UnknownNameError if the robot has no binding to the middleware.
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
