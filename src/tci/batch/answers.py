"""A capability in each of many worlds, for example the withdrawal reflex."""

from __future__ import annotations

from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from tci.batch.worlds import Worlds
from tci.capabilities.capability import Capability
from tci.errors import CommandError
from tci.messages import Mode, PlatformCommand

M = TypeVar("M")


class Answers(Generic[M]):
    """Runs one capability in all worlds, each with a memory of its own: the code that robots run, in Python.

    Its commands go to the limiter of the worlds, and its speeds are not kept. Worlds that are neither touched
    nor answered are left out. Raises CommandError for a capability that does not command positions.
    """

    def __init__(self, worlds: Worlds, capability: Capability[M]) -> None:
        self.worlds, self.capability = worlds, capability
        self.memories: list[M] = [capability.init(worlds.scene.body) for _ in range(worlds.count)]
        """Memory of each world."""
        self._targets = np.full((worlds.count, len(worlds.scene.robot.servos)), np.nan)
        worlds.track()

    def step(self) -> NDArray[np.intp]:
        """Answers the latest frames. Returns the worlds with new commands."""
        body, moved = self.worlds.scene.body, []
        for w, memory in enumerate(self.memories):
            if not (self.worlds.touched[w] or self.capability.claims(memory)):
                continue
            perception = self.worlds.perceive(w)
            orders, self.memories[w] = self.capability.step(memory, perception, body)
            assert perception.joints is not None  # `perceive` gives them
            for order in body.to_platform(orders, perception.joints)[0] if orders else ():
                if not isinstance(order, PlatformCommand) or order.mode is not Mode.POSITION:
                    raise CommandError(f"{order.mode.value} in a batch; valid: {Mode.POSITION.value}")
                self._targets[w, order.servos] = order.values
                moved.append(w)
        if moved:
            self.worlds.send(self._targets)
        return np.unique(np.array(moved, np.intp))
