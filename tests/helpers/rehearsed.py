"""Rehearses faults over a G1's topics: a served robot moves, an injector changes its data, and the gate and
the loop react."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from helpers.rehearsal import ARMS, Sway
from helpers.wire_peers import Unitree
from tci.body.generic_body import GenericBody
from tci.drivers.driver import Driver
from tci.errors import DriverError
from tci.gate.gate import GateState
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.messages import GenericCommand, Mode, Perception
from tci.runtime.loop import Tick, run
from tci.wires.unitree.driver import UnitreeDriver

AT, LONG = 0.6, 1.2
"""Time [s] at which the fault begins, and duration [s] of the run after this time."""
LONGER = {"stall": 4.0}
"""Durations [s] of runs in which the arms go back where they came from, and rest there."""
SHORT = {"nan-angle": 0.2, "dropped-frames": 0.9, "out-of-order": 0.3, "duplicates": 0.3, "clock-jump": 0.3}
"""Durations [s] of temporary faults. All other faults last until the end."""
EXPECTED = {
    "nan-angle": {GateState.RUN, GateState.HOLD},
    "dropped-frames": {GateState.RUN, GateState.HOLD},
    "out-of-order": {GateState.RUN},
    "duplicates": {GateState.RUN},
    "clock-jump": {GateState.RUN},
    "overrun": {GateState.RUN, GateState.HOLD},
    "frozen-source": {GateState.STOP},
    "wrong-direction": {GateState.STOP},
    "stale-encoder": {GateState.STOP},
    "stall": {GateState.STOP},
    "servo-off": {GateState.STOP},
    "mode-mismatch": {GateState.STOP},
    "encoder-step": {GateState.STOP},
    "link-lost": {GateState.STOP},
}
"""Expected gate states after the beginning of the fault, as in a rehearsal within one process. A robot that
must stop may hold before."""
SPEED = 0.3
"""Speed [rad/s] of the arms, always in one direction. If the direction changed, the delay of a busy machine
would look like a motion against the command."""
HALF = 1.5
"""Shoulder flexion [rad] above which an arm is lowered. Each rehearsal starts in the last posture of the
previous one."""
STILL = 0.05
"""Largest speed [rad/s] of a robot at rest."""
LATE = 0.03
"""If the time [s] without a period, or the age [s] of the robot's own data, exceeds this value, the machine
gave the robot too little processor time. Assumed: a quarter of the delay that the gate tolerates."""


class Rehearsed(NamedTuple):
    """Outcome of a rehearsal."""

    wrong: str
    """Difference from the expected result; empty if there is none."""
    late: bool
    """True if the machine, not the fault, delayed the loop or the robot."""


class Raise(Sway):
    """Raises both arms continuously, or lowers arms that are raised."""

    def step(
        self, memory: None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[GenericCommand, ...], None]:
        self.since = getattr(self, "since", perception.stamp)
        raised = [self.home[part].copy() for part in ARMS]
        for angles in raised:
            angles[0] += np.sign(HALF - angles[0]) * SPEED * (perception.stamp - self.since)
        return tuple(map(GenericCommand, ARMS, (Mode.POSITION,) * 2, raised)), None


def rehearse(peer: Unitree, name: str) -> Rehearsed:
    """Rehearses one fault."""
    try:
        driver = peer.open(arm=True)
    except DriverError as error:  # the driver was not connected in time
        return Rehearsed(str(error), late=True)
    assert isinstance(driver, UnitreeDriver)
    with driver:
        faulty = FaultInjector(driver, [FaultPlan(name, AT, SHORT.get(name, math.inf))])
        ticks: list[Tick] = []
        ages: list[float] = []
        lost = ""

        def see(tick: Tick) -> None:
            ticks.append(tick)
            joints = getattr(
                driver, "_joints", None
            )  # data from the robot, which the injector does not change
            ages.append(0.0 if joints is None else tick.now - joints.stamp)

        try:
            run(faulty, Raise(), duration=AT + LONGER.get(name, LONG), observe=see)
        except DriverError as error:
            lost = str(error)
        begin = ticks[0].now + AT
        # In one of the faults, the fault itself makes the loop late.
        judged = begin if name == "overrun" else math.inf
        gaps = np.diff([tick.now for tick in ticks if tick.now < judged])
        late = bool(np.max(gaps, initial=0.0) > LATE or np.max(ages, initial=0.0) > LATE)
        return Rehearsed(_difference(driver, name, ticks, lost), late)


def _difference(driver: Driver, name: str, ticks: list[Tick], lost: str) -> str:
    """Returns the difference from the expected result of one fault; empty if there is none."""
    expected, begin = EXPECTED[name], ticks[0].now + AT
    before = {tick.sent.state for tick in ticks if tick.now < begin - 0.01}
    after = {tick.sent.state for tick in ticks if tick.now > begin + 0.02} | {driver.gate.state}
    if GateState.STOP in before:
        return f"it stopped before the fault: {driver.gate.reason}"
    if bool(lost) is not (name == "link-lost"):
        return f"the run ended with {lost or 'nothing'}"
    if expected == {GateState.STOP}:
        if driver.gate.state is not GateState.STOP:
            return f"it is in {driver.gate.state.value} at the end"
        if name != "link-lost" and np.abs(ticks[-1].sent.velocity).max() > 1e-9:
            return "its references still move at the end"
    elif GateState.STOP in after or (GateState.HOLD in expected and GateState.HOLD not in after):
        return f"{sorted(state.value for state in after)}: {driver.gate.reason}"
    for _ in driver.ticks(duration=0.3):
        joints = driver.read().joints
    if expected == {GateState.STOP} and np.abs(joints.velocity).max() > STILL:
        return f"the robot still moves at {np.abs(joints.velocity).max():.2f} rad/s"
    return ""
