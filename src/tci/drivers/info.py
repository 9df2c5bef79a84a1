"""Facts about a connection to a robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Self

from tci.gate.gate import Gate
from tci.gate.settings import GateSettings, over_a_wire
from tci.messages.clock import Clock
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot

STREAMS = "streams"
"""Key in `about` of `Gate.streams`, on which the gate's decisions depend."""
HARMLESS = ("sim", "replay")
"""Names of the drivers that move no hardware. These drivers are armed by default."""
SOFTEN = "unitree"
"""The one whose robots take a share of the stiffness in every mode, and have no other stiffness than TCI's: a
NAO's may have been set elsewhere, and would not get that back."""


def moves_nothing_real(via: str) -> bool:
    """True if the first driver of an address, which moves the robot, is harmless: `sim + inspire:...`."""
    return via.split(" + ")[0].partition(":")[0] in HARMLESS


@dataclass(frozen=True, slots=True, eq=False)
class DriverInfo:
    """Facts about one connection to a robot. A driver that wraps another driver replaces some of these
    facts."""

    robot: Robot
    clock: Clock
    """Clock of all time stamps."""
    gate: Gate
    """Safety gate of the driver. The driver writes only commands that this gate created. The gate's period is
    the time between two commands."""
    armed: bool
    """True if the driver may send commands."""
    lease_name: str
    """Name of the lease, which is the right to command the robot. Drivers with equal lease names connect to
    the same robot, and only one process may command the robot at a time."""
    keep_alive: float | None = None
    """Longest time [s] between two frames of a patch, if the robot sends a frame only when values change
    (send-on-delta). The value is None if the robot sends every frame."""
    about: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Facts that a recording stores because they are needed to repeat the run. Examples are the random seed
    and the time step of a simulation."""
    recorded: bool = False
    """True if the driver replays a recording. In this case `write` moves no robot, and `read` returns each
    reading only once."""
    unreached: Mapping[int, str] = field(default_factory=lambda: MappingProxyType({}))
    """Reasons why the driver can't move some servos, by servo index. A servo that the driver can move has no
    entry."""
    unmeasured: frozenset[int] = frozenset()
    """Servos whose angles this driver can't measure; readings say 0. A source beside it may know them."""
    left_out: tuple[str, ...] = ()
    """Patches that the address leaves out, so that nobody waits for their frames."""
    sources: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Addresses of the sources beside the robot's own driver, by the patch that they feel."""

    @property
    def streams(self) -> bool:
        """True if the mode of a part may change while it moves, see `Gate.streams`."""
        return self.gate.streams

    @property
    def harmless(self) -> bool:
        """True if the connection moves no hardware. The robot is simulated or recorded, and only this process
        can use it."""
        return self.lease_name.partition(":")[0] in HARMLESS

    @classmethod
    def of(
        cls,
        robot: RobotLike,
        middleware: str,
        *,
        clock: Clock,
        armed: bool,
        lease_name: str | None = None,
        settings: GateSettings | None = None,
        streams: bool = False,
        period: float | None = None,
        keep_alive: float | None = None,
        about: Mapping[str, str] | None = None,
        recorded: bool = False,
    ) -> Self:
        """Returns the facts about a connection over `middleware`. They contain a new gate for this
        connection, with `settings` and `streams`. `period` [s] is the time between two commands, by default
        the value in the robot's binding (the description's settings for this middleware). By default,
        `lease_name` consists of the names of middleware and robot.

        Raises UnknownNameError if the robot has no binding to the middleware.
        """
        robot = as_robot(robot)
        binding = robot.binding(middleware)
        usual = GateSettings() if middleware in HARMLESS else over_a_wire(softens=middleware == SOFTEN)
        gate = Gate(
            robot, period=period or 1.0 / binding.rate, stale_after=binding.stale_after,
            settings=settings or usual, streams=streams,
        )  # fmt: skip
        return cls(
            robot=robot,
            clock=clock,
            gate=gate,
            armed=armed,
            lease_name=lease_name or f"{middleware}:{robot.name}",
            keep_alive=keep_alive,
            about={**(about or {}), STREAMS: str(streams).lower()},
            recorded=recorded,
        )
