"""Random runs of the loop with commands in all modes, faults and an operator. Invariants that must always
hold are checked."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

import tci
from helpers.felt import NoisySkin
from helpers.hostile_commands import Judge
from tci.body.generic_body import GenericBody
from tci.errors import CommandError
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.lab.faults.injectors import INJECTORS
from tci.messages import CONTROL_MODES, GenericCommand, Mode, Order, Perception, SwitchMode
from tci.reasons import Code
from tci.runtime.loop import Tick, run
from tci.runtime.loop_report import LoopReport

LETHAL = ("sigterm", "thread-fails", "link-lost")
"""Faults that end the loop and leave the robot at rest."""
NAMES = tuple(name for name in INJECTORS if name not in LETHAL)
EPISODE = 12.0
"""Duration [s] of one run."""


@dataclass
class Seen:
    """Observations so far in one run."""

    steps: int = 0
    transitions: Counter[tuple[GateState, GateState]] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)
    """Descriptions of invariants that were violated."""


class Restless(tci.Capability[None]):
    """A capability that sends random commands, some of them invalid, and sometimes switches the mode."""

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random

    def init(self, body: GenericBody) -> None:
        return None

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], None]:
        random, orders = self.random, []
        for part, posture in perception.posture.items():
            if random.random() < 0.02:
                orders.append(SwitchMode(part, CONTROL_MODES[int(random.integers(4))]))
            if random.random() < 0.1:
                mode = list(Mode)[int(random.integers(len(Mode)))] if random.random() < 0.5 else Mode.POSITION
                values = posture + random.uniform(-1.0, 1.0, posture.size)
                if random.random() < 0.1:
                    values[int(random.integers(values.size))] = random.choice([np.nan, np.inf, 1e300])
                if random.random() < 0.05:
                    values = values[:-1]
                orders.append(GenericCommand(part, mode, values))
        return tuple(orders), None


class Explorer:
    """Runs several loops in sequence. Each run has other random faults."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.seen = Seen()

    def episode(self, duration: float = EPISODE) -> None:
        """Runs a loop for `duration` [s] with up to four faults."""
        random, seen = self.random, self.seen
        driver = NoisySkin(body=False)
        names = random.choice(NAMES, int(random.integers(0, 5)), replace=False).tolist()
        plans = [FaultPlan(n, random.uniform(0.0, duration), random.uniform(0.05, 2.0)) for n in names]
        if random.random() < 0.1:
            plans.append(FaultPlan(str(random.choice(LETHAL)), random.uniform(0.0, duration)))
        faulty = FaultInjector(driver, plans)
        judge = Judge(driver.robot, driver.period)
        before = [GateState.RUN, GateState.RUN]
        stiff = dict[int, float]()

        def observe(tick: Tick) -> None:
            seen.steps += 1
            state = tick.sent.state
            seen.transitions[before[0], state] += 1
            if before[0] is GateState.STOP and state is not GateState.STOP and before[1] is GateState.STOP:
                seen.broken.append("STOP was left without a reset")
            before[0] = before[1] = state
            judge.see(tick.sent, tick.reading.joints.position)
            # who is pressed is freed in any state, by an arm that gets softer; nobody else's order passes
            freed = tick.sent.met or any(why.code is Code.CONTACT for why in tick.sent.clamped)
            for servo, share in tick.sent.stiffness.items():
                if state is not GateState.RUN and not (freed and share <= stiff.get(servo, 1.0)):
                    seen.broken.append(f"stiffness in {state.value}")
                stiff[servo] = max(share, stiff.get(servo, 1.0)) if freed else share
            if state is not GateState.RUN and not tick.sent.reason:
                seen.broken.append(f"{state.value} without a reason")
            if state is not GateState.RUN and len(tick.sent.refusals) < len(tick.commands):
                seen.broken.append(f"a command was accepted in {state.value}")
            if random.random() < 0.003:
                driver.gate.stop("the operator")
            if random.random() < 0.05:
                try:
                    driver.gate.reset()
                except CommandError:
                    return
                judge.forget()
                before[1] = GateState.RUN

        report = LoopReport()
        try:
            run(faulty, Restless(random), duration=duration, observe=observe, report=report)
        except (SystemExit, RuntimeError, tci.errors.DriverError) as error:
            if not any(plan.name in LETHAL for plan in faulty.begun):
                seen.broken.append(f"the loop ended: {error!r}")
            if driver.gate.state is not GateState.STOP:
                seen.broken.append("the loop ended in an error and the gate did not stop")
        faulty.close()
        seen.faults.update(plan.name for plan in faulty.begun)
        seen.broken += judge.faults
        if report.ticks != seen.steps - getattr(self, "_counted", 0) and report.ended == "done":
            seen.broken.append("ticks were not counted")
        self._counted = seen.steps
