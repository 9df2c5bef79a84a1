"""`sim`: the robot that is not there, behind the same link as a real one."""

from __future__ import annotations

from typing import Any

from tci.interface.gate import SafeCommand
from tci.messages import Reading
from tci.middleware.link import Link
from tci.model.description import Robot
from tci.simulation.world import World


class WorldClock:
    """A clock that is the simulation: sleeping on it steps the physics."""

    def __init__(self, world: World) -> None:
        self._world = world

    def now(self) -> float:
        return self._world.time

    def sleep_until(self, stamp: float) -> None:
        self._world.advance(stamp)


class SimulatedLink(Link):
    """A link to a simulated robot. It is armed from the start, since nothing can be hurt."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = True, **options: Any) -> None:
        """`options` go to `tci.simulation.world.World`: `step`, `seed`, `posture`, ..."""
        del address  # there is only one simulation in a process
        self.world = World(robot, **options)
        """The simulated world: poke its `finger`, look at its physics."""
        super().__init__(robot, middleware="sim", clock=WorldClock(self.world), armed=arm)

    def _receive(self) -> Reading:
        return Reading(joints=self.world.joints(), skin=self.world.frames())

    def _send(self, safe: SafeCommand) -> None:
        self.world.apply(safe)

    def _close(self) -> None:
        pass
