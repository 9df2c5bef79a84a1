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
    """Facts about one connection to a robot. A wrapper changes some of them for its own."""

    robot: Robot
    clock: Clock
    """Clock of all stamps."""
    gate: Gate
    """The only maker of what the driver writes. Its period is the one of the commands."""
    armed: bool
    """Whether the driver may write."""
    lease_name: str
    """Drivers of the same name reach the same robot; only one of them commands it at a time."""
    keep_alive: float | None = None
    """Longest time [s] without a frame of a patch, where the skin's senders send changes only; None where
    they send every frame."""
    about: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Facts that a recording needs so that its run can be repeated: seed and step of the physics."""
    recorded: bool = False
    """Whether the driver replays a recording: nothing moves by what is written, and each reading is given
    once."""

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

        `settings` are the gate's. Unless given, the binding tells the `period` [s] of the commands, and robot
        and middleware make the `lease_name`.

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
