"""The pads of a simulated hand, read as those of a device: the simulated finger presses one after another."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import cycle

import numpy as np

from tci.drivers.simulated import PacedWorldClock
from tci.drivers.source import Sample, Source
from tci.errors import TciError
from tci.robot.description import Grid, Robot
from tci.robot.tactile_devices import DevicePad
from tci.simulation.world import World
from tci.skin.layout import SkinLayout
from tci.skin.surfaces import surfaces_of

PRESSES, GAP = 0.4, 0.2
"""How long [s] each pad is pressed, and the time until the next one. Assumed: slow enough to be watched."""
EVERY = 0.02
"""Time [s] between two frames."""


class SimulatedPads(Source):
    """The pads on the hands of a robot that is simulated in real time. Values are forces [mN] of taxels."""

    newton_per_count = 1e-3

    def __init__(self, robot: Robot) -> None:
        super().__init__()
        self._robot = robot
        self._patches = [one for one in robot.patches if robot.part(one.part).kind == "fingers"]
        surfaces = surfaces_of(robot)
        count = {one.patch: len(one.positions) for one in surfaces}
        self.pads = {one.name: count[one.name] for one in self._patches}
        self.shapes = {
            one.name: DevicePad(one.name, one.surface.rows, one.surface.columns)
            for one in self._patches if isinstance(one.surface, Grid)
        }  # fmt: skip
        """Rows and columns of the pads that are grids."""
        self._world: World | None = None

    def open(self) -> None:
        self._world = World(self._robot)
        self._layout = SkinLayout.of_robot(self._robot)
        self._clock, self._presses = PacedWorldClock(self._world), self._pressing(self._world)

    def read(self) -> Iterator[Sample]:
        assert self._world is not None  # opened before
        self._clock.sleep_until(self._world.time + EVERY)
        next(self._presses)
        for frame in self._world.frames():
            if frame.patch in self.pads:
                patch = self._layout.patches[self._layout.places[frame.patch]]
                sensor = patch.description.sensor
                away = np.asarray(frame.values, dtype=float)[patch.channels] - sensor.rest
                pressure = sensor.pressure(away * np.sign(sensor.pascal_per_count))
                force = np.maximum(pressure * patch.surface.areas, 0.0)
                yield Sample(frame.patch, force / self.newton_per_count, self._world.time)

    def close(self) -> None:
        self._world = None

    def _pressing(self, world: World) -> Iterator[None]:
        """Presses the middle of each pad that the finger reaches, one after another, for ever."""
        for patch in cycle(self._patches):
            with suppress(TciError):  # no room: the next one
                world.finger.poke(patch.name, patch.channels // 2, depth=0.005)
            begun = world.time
            while world.time < begun + PRESSES:
                yield
            world.finger.retire()
            while world.time < begun + PRESSES + GAP:
                yield
