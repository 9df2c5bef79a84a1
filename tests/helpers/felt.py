"""A robot with noisy skin, simulated as fast as possible. Counts the responses of its reflex."""

from __future__ import annotations

from typing import Literal

import numpy as np

import tci
from tci.body.generic_body import GenericBody
from tci.capabilities.withdrawal import WithdrawalMemory
from tci.capabilities.wrapper import CapabilityWrapper
from tci.gate.gate import GateSettings
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.messages import Order, Perception, SkinFrame
from tci.messages.frames import Array
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport
from tci.skin.skin import Skin
from tci.testing import FakeDriver

RATE = 50.0
ROBOT = tci.load_robot("nao")
PATCH = ROBOT.patches[0]
"""Patch whose frames the injectors change."""
OTHER = next(p for p in ROBOT.patches if p.part != PATCH.part and p.segment == "forearm")
JUST_FELT = 40.0
"""Amplitude [counts] of a touch to which the reflex responds."""


class NoisySkin(FakeDriver):
    """A NAO that reaches commanded angles immediately. Its skin has noise of one count. `touch` adds a
    pressed area."""

    def __init__(self, *, noise: float = 1.0, body: bool = True) -> None:
        """Starts the robot. With `body` the gate checks self-collision, which needs most of the computing
        time."""
        super().__init__(ROBOT, rate=RATE, settings=None if body else GateSettings(self_collision=None))
        self.noise, self.random = noise, np.random.default_rng(3)
        self.touches: list[tuple[float, float, str, np.ndarray, float]] = []

    def touch(
        self, begin: float, end: float, patch: str = PATCH.name, *, count: int = 12, counts: float = JUST_FELT
    ) -> None:
        """Presses the taxels nearest to a field of the patch's segment from `begin` to `end` [s]."""
        skin = Skin(ROBOT)
        words = ROBOT.patch(patch)
        field = next(f for f in tci.WithdrawalReflex().fields if f.segment == words.segment)
        u, theta, _ = skin.limb(patch, self.joints())
        turn = np.abs((theta - field.theta + np.pi) % (2 * np.pi) - np.pi)
        nearest = np.argsort(np.hypot(u - field.u, turn / np.pi))[:count]
        self.touches.append((begin, end, patch, skin.surfaces[patch].channels[nearest], counts))

    def scatter(self, begin: float, end: float, count: int) -> None:
        """Presses `count` single taxels on all patches. No two of these taxels are neighbours."""
        skin = Skin(ROBOT)
        left = count
        for patch in ROBOT.patches:
            surface, chosen = skin.surfaces[patch.name], []
            free = np.ones(len(surface.channels), dtype=bool)
            beside = np.zeros((len(free), len(free)), dtype=bool)
            one, other = surface.neighbours.T
            beside[one, other] = beside[other, one] = True
            while left and free.any():
                taxel = int(np.flatnonzero(free)[0])
                chosen.append(taxel)
                around = beside[taxel] | (beside & beside[taxel]).any(axis=1)
                free[[taxel, *np.flatnonzero(around)]] = False
                left -= 1
            self.touches.append((begin, end, patch.name, surface.channels[chosen], JUST_FELT))

    def frames(self, now: float, sequence: int) -> list[SkinFrame]:
        return [SkinFrame(patch, now, sequence, self._frame(patch, now)) for patch in self.skin]

    def _frame(self, name: str, now: float) -> Array:
        patch = ROBOT.patch(name)
        sensor = patch.sensor
        values = sensor.rest + self.noise * self.random.standard_normal(patch.channels)
        for begin, end, touched, channels, counts in self.touches:
            if touched == name and begin <= now < end:
                values[channels] += counts * np.sign(sensor.pascal_per_count)
        return np.clip(np.rint(values), sensor.lowest, sensor.highest)


class Counted(CapabilityWrapper[WithdrawalMemory]):
    """The withdrawal reflex. It also records, by arm, the times at which a response began."""

    def __init__(self, response: Literal["blended", "meant"] = "blended") -> None:
        super().__init__(tci.WithdrawalReflex(response=response))
        self.answers: dict[str, list[float]] = {"left_arm": [], "right_arm": []}

    def step(
        self, memory: WithdrawalMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], WithdrawalMemory]:
        commands, memory = super().step(memory, perception, body)
        for part, withdrawal in memory.items():
            if withdrawal.started not in self.answers[part]:
                self.answers[part].append(withdrawal.started)
        return commands, memory


class Felt:
    """A run of this robot with one fault, which begins at `at` [s]."""

    def __init__(
        self,
        driver: NoisySkin,
        name: str,
        *,
        at: float,
        duration: float,
        lasts: float = np.inf,
        response: Literal["blended", "meant"] = "blended",
    ) -> None:
        self.ticks: list[Tick] = []
        self.reflex, self.report = Counted(response), LoopReport()
        self.at = at
        faulty = FaultInjector(driver, [FaultPlan(name, at, lasts)])
        self.memory = run(
            faulty, self.reflex, duration=duration, observe=self.ticks.append, report=self.report
        ).memory

    def answers(self, part: str) -> list[float]:
        """Returns the times [s] after the fault at which an arm began to withdraw. Responses at the beginning
        of the run, when the noise is still unknown, are left out."""
        return [started - self.at for started in self.reflex.answers[part] if started > self.at - 1.0]
