"""A run with one fault: the arms swing in any mode, and an injector changes the readings."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

import tci
from tci.body.generic_body import GenericBody
from tci.drivers.simulated import SimulatedDriver
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport

AT = 0.2
ARMS = ("left_arm", "right_arm")
PUSH = 3.0
"""Torque [N m] on the first joint of each arm."""


class Sway(tci.Capability[None]):
    """Swings both arms continuously."""

    def __init__(self, mode: Mode = Mode.POSITION) -> None:
        self.mode = mode

    def init(self, body: GenericBody) -> None:
        return None

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        self.home = {name: np.array(angles) for name, angles in perception.posture.items()}
        return () if self.mode is Mode.POSITION else tuple(SwitchMode(part, self.mode) for part in ARMS)

    def step(
        self, memory: None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], None]:
        swing = math.sin(6.0 * perception.stamp)
        commands = []
        for part in ARMS:
            values = np.zeros(len(self.home[part])) if self.mode is Mode.TORQUE else self.home[part].copy()
            values[0] += (PUSH if self.mode is Mode.TORQUE else 0.3) * swing
            commands.append(GenericCommand(part, self.mode, values))
        return tuple(commands), None


class Rehearsal:
    """A run with one fault. Records its periods and its report."""

    def __init__(
        self, driver: SimulatedDriver, name: str, *, lasts: float = math.inf, mode: Mode = Mode.POSITION,
        behaviour: tci.Capability[Any] | None = None,
    ) -> None:  # fmt: skip
        self.report = LoopReport()
        self.ticks: list[Tick] = []
        self.faulty = FaultInjector(driver, [FaultPlan(name, AT, lasts)])
        swayed = Sway(mode) if behaviour is None else behaviour
        run(self.faulty, swayed, duration=0.8, observe=self.ticks.append, report=self.report)
        assert [plan.name for plan in self.faulty.begun] == [name]
        before = {tick.sent.state for tick in self.ticks if tick.now < AT - 1e-9}
        assert before == {GateState.RUN}, "it must be well before the fault"

    @property
    def states(self) -> set[GateState]:
        return {tick.sent.state for tick in self.ticks}

    def stopped_after(self) -> float:
        """Returns the time [s] from the fault to the stop. Checks that the stop lasts and that the references
        come to rest."""
        first = next(i for i, tick in enumerate(self.ticks) if tick.sent.state is GateState.STOP)
        assert all(tick.sent.state is GateState.STOP for tick in self.ticks[first:])
        assert np.abs(self.ticks[-1].sent.velocity).max() < 1e-9
        last = self.ticks[-1]
        assert len(last.sent.refusals) == len(last.commands), "commands are refused while it is stopped"
        return self.ticks[first].now - AT
