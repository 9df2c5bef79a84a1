"""`sim`: driver of a simulated robot, with the interface of the drivers of real robots."""

from __future__ import annotations

import os
from inspect import signature
from typing import Any

import numpy as np

from tci.drivers.driver import Driver
from tci.drivers.info import DriverInfo
from tci.errors import DriverError, UnknownNameError
from tci.gate.gate import SafeCommand
from tci.messages import Mode, Reading, SkinFrame
from tci.messages.clock import MonotonicClock, SteppedClock
from tci.robot.like import RobotLike, as_robot
from tci.simulation.world import World
from tci.skin.send_on_delta import SendOnDelta

FASTEST = 10_000.0
"""Highest rate [Hz] of commands that can be set. Assumed: ten times the rate of the fastest robots'
controllers."""
LATE = 0.1
"""Longest delay [s] after which a simulation in real time (`paced`) catches up by running faster. Assumed: if
it caught up after a longer delay, the robot would seem to jump."""


class WorldClock(SteppedClock):
    """The clock of the simulation. `sleep_until` does not wait, but runs the simulation until the given
    time."""

    def __init__(self, world: World) -> None:
        self._world = world

    def now(self) -> float:
        return self._world.time

    def sleep_until(self, stamp: float) -> None:
        self._world.advance(stamp)


class PacedWorldClock(WorldClock):
    """A clock of the simulation that is no faster than real time.

    External programs that use the simulation need such a clock.
    """

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._pace = MonotonicClock()
        self._ahead = self._pace.now() - world.time
        self.late = 0.0
        """Real time [s] that the simulation has lost, because this machine is too slow or too busy."""

    def sleep_until(self, stamp: float) -> None:
        super().sleep_until(stamp)
        late = self._pace.now() - (self.now() + self._ahead)
        if late > LATE:
            self._ahead += late
            self.late += late
        self._pace.sleep_until(self.now() + self._ahead)


class SimulatedDriver(Driver):
    """A driver of a simulated robot. The driver is always armed, since a simulation can cause no harm."""

    def __init__(
        self,
        robot: RobotLike,
        address: str = "",
        *,
        arm: bool = True,
        world: World | None = None,
        paced: bool = False,
        keep_alive: float | None = None,
        rate: float | None = None,
        **options: Any,
    ) -> None:
        """Connects to `world`, or to a new `World` with `options`: `step`, `seed`, `posture`, ...

        - `rate`: rate [Hz] of the commands; by default the rate in the robot's description.
        - `paced`: the simulation runs no faster than real time.
        - `keep_alive` [s]: a skin frame is sent when its values change (send-on-delta), and at least once in
          this time. By default a skin frame is sent in every period.

        Raises DriverError if `address` is not empty, if the rate is invalid, or if both `world` and `options`
        are given. Raises UnknownNameError for an unknown option.
        """
        robot = as_robot(robot)
        if address:
            raise DriverError(f"the simulation has no address; got {address!r}, valid: sim")
        if rate is not None and not 1.0 <= rate <= FASTEST:
            raise DriverError(f"rate {rate}; valid: 1 to {FASTEST:g} Hz")
        for name in options:
            if name not in (valid := _options()):
                raise UnknownNameError("option of the driver 'sim'", name, valid)
        if world is not None and options:
            raise DriverError(
                f"{', '.join(options)} for a world that exists already; valid: World(...) takes them"
            )
        period = None if rate is None else 1.0 / rate
        self.world = world or World(robot, period=period, **options)
        """The simulated world: its physics, and the simulated finger that touches the skin."""
        clock = PacedWorldClock(self.world) if paced else WorldClock(self.world)
        super().__init__(
            DriverInfo.of(
                robot, "sim", clock=clock, armed=arm, period=period, keep_alive=keep_alive,
                streams=True,
                lease_name=f"sim:{robot.name}:{os.getpid()}:{id(self.world)}",
                about={"seed": str(self.world.seed), "step_s": repr(self.world.step)},
            )
        )  # fmt: skip
        self._events = None if keep_alive is None else SendOnDelta(keep_alive)
        self._sent: dict[str, SkinFrame] = {}
        self._modes: tuple[Mode, ...] = ()
        self._has_torque = False

    def _receive(self) -> Reading:
        skin = self.world.frames()
        if self._events is not None:
            self._sent.update({frame.patch: frame for frame in self._events.select(skin)})
            skin = tuple(self._sent.values())
        return Reading(joints=self.world.joints(), skin=skin)

    def _send(self, safe: SafeCommand) -> None:
        if safe.modes != self._modes:
            self._modes, self._has_torque = safe.modes, Mode.TORQUE in safe.modes
        if safe.servos.size:
            self.world.set_modes(safe.servos, safe.modes)
        if self._has_torque:
            loose = np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)
            self.world.set_position_targets(safe.servos[~loose], safe.position[~loose])
            self.world.set_torques(safe.servos[loose], safe.torque[loose])
        elif safe.servos.size:
            self.world.set_position_targets(safe.servos, safe.position)
        if safe.stiffness or safe.damping:
            for servo, share in safe.stiffness.items():
                self.world.set_stiffness([servo], [share])
            for servo, share in safe.damping.items():
                self.world.set_damping([servo], [share])

    def _halt(self) -> None:
        self.world.halt()

    def _close(self) -> None:
        pass


def _options() -> list[str]:
    """Returns the names of the options of a simulated driver and of its world."""
    both = *signature(SimulatedDriver).parameters.values(), *signature(World).parameters.values()
    return [one.name for one in both if one.kind is one.KEYWORD_ONLY and one.name != "period"]
