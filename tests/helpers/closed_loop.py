"""Hostile commands and false readings around a simulated plant, and a judge that checks the plant's true
motion."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from helpers.hostile_commands import Attack
from helpers.joint_plant import Plant
from tci.gate.gate import GateState, SafeCommand
from tci.messages import JointReading, Mode, PlatformOrder, PlatformSwitch
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot

BLIND = 0.05
"""Time [s] after the last new reading after which no torque may be sent."""
OVER = 0.5
"""Fraction of the speed limit by which a joint may exceed this limit while its readings are correct or
missing."""
PRESSED = 0.02
"""Depth [rad] by which a joint may press into its mechanical stops, which are slightly elastic."""
LIES = 2.5
"""Multiple of its speed limit that a joint may reach while its readings are wrong but have new time
stamps."""
UNSEEN, UNSEEN_FOR = 0.15, 0.2
"""Angle error [rad] of a joint in torque mode above which no torque may be sent, and additional time [s] at
the speed limit until then."""
CHANGE = 0.32
"""Largest change of a torque, as a fraction of the torque limit, while angle and velocity repeat. A constant
torque may continue, because the readings of a blocked joint also repeat."""
MOVED, TOLD = 0.3, 0.8
"""Speed [rad/s] above which torques end if a reading repeats both this speed and the angle, and the longest
time [s] until they end."""
AFTER = 0.5
"""Time [s] after a wrong reading in which effects of the reading are tolerated."""
REST_IN = 1.0
"""Time [s] within which all joints must come to rest when no motion is permitted any more."""
SLOW = 0.02
"""Speed [rad/s] below which a joint is at rest."""
HONEST = ("none", "repeated", "frozen", "late", "reordered", "errors", "spoilt", "calm")
"""Names of faults whose readings are correct or visibly faulty. `calm`: correct readings while the robot
holds."""
LYING = ("stale angle", "stuck", "mirrored")
"""Names of faults whose readings look correct, with new time stamps and sequence numbers."""
SPEEDS = ("no velocity", "mirrored velocity")
"""Names of faults with wrong velocities and correct angles. Correct angles are sufficient to keep the speed
limit of a joint."""


@dataclass(frozen=True)
class Shown:
    """Reading that the gate receives in a period, and its difference from the true state."""

    fault: str
    """Name of the fault."""
    lasts: float
    """Time [s] since the beginning of the fault."""
    lies: bool
    """True if the reading is wrong but looks correct, or if this was the case shortly before."""
    joints: JointReading
    """The reading. If it is missing or unusable, the last usable reading."""
    age: float
    """Age [s] of the newest true reading."""


class TrueJudge:
    """Judges the plant's true motion. Uses the readings that the gate received, but no results of the
    gate."""

    def __init__(self, robot: Robot, plant: Plant) -> None:
        self.robot, self.plant = robot, plant
        self._speed = np.array([servo.limits.velocity or np.inf for servo in robot.servos])
        self._torque = np.array([servo.limits.torque or np.inf for servo in robot.servos])
        self._energy: Array | None = None
        self._pushes = np.zeros((2, len(robot.servos)))
        self._still, self._stuck = 0.0, False
        self._coasts = np.full(len(robot.servos), np.nan)
        self.faults: list[str] = []
        self.largest: dict[str, float] = {}
        """Largest ratio of each quantity to its bound."""

    def see(self, safe: SafeCommand, shown: Shown, period: float) -> None:
        """Checks the true motion in a period in which a command was executed."""
        plant, index = self.plant, safe.servos
        loose = np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)
        sent = plant.sent / self._torque
        self._stuck = shown.fault == "stuck" or (self._stuck and shown.lies)
        free = np.setdiff1d(index, self._coasting(index[loose], shown))
        if not (self._stuck and loose.any()):
            what, most = ("speed from a wrong angle", LIES) if shown.lies else ("speed", 1.0 + OVER)
            self._bound(what, free, np.abs(plant.velocity) / self._speed, most)
            self._bound("into a stop", index, plant.beyond, PRESSED * most)
        self._see_torque(index[loose], sent, shown)
        self._still = 0.0 if safe.state is GateState.RUN else self._still + period
        if self._still > REST_IN and not shown.lies:
            self._bound("speed at rest", index[~loose], np.abs(plant.velocity), SLOW)
        if shown.fault == "calm" and shown.lasts > REST_IN:
            self._bound("speed at rest", index, np.abs(plant.velocity), SLOW)

    def _coasting(self, index: NDArray[np.intp], shown: Shown) -> NDArray[np.intp]:
        """Returns the joints among the servos (k,) that have been too fast since a wrong reading.

        While no reading is trusted the gate can't brake these joints, and later braking needs time. Therefore
        these joints must only lose energy.
        """
        plant, speed = self.plant, np.abs(self.plant.velocity) / self._speed
        energy = plant.energy + 0.1 * plant.inertia * self._speed**2
        if shown.lies:
            self._coasts = energy
            return index[:0]
        if shown.fault in SPEEDS:
            self._coasts = np.where(speed <= 1.0 + OVER, energy, self._coasts)
        else:
            self._coasts[(speed <= 1.0) & (plant.sent != 0.0)] = np.nan
        coasting = index[np.isfinite(self._coasts[index]) & (speed[index] > 1.0 + OVER)]
        self._bound("energy after a wrong angle", coasting, plant.energy / self._coasts, 1.0)
        return coasting

    def _see_torque(self, index: NDArray[np.intp], sent: Array, shown: Shown) -> None:
        plant = self.plant
        blind = not shown.lies and shown.age >= BLIND - 1e-9
        if blind:
            self._bound("torque without a fresh reading", index, np.abs(sent), 1e-9)
            if self._energy is None:
                self._energy = plant.energy + 0.1 * plant.inertia * self._speed**2
            self._bound("energy without a fresh reading", index, plant.energy / self._energy, 1.0)
        else:
            self._energy = None
        if shown.fault in ("stale angle", "mirrored"):
            far = np.abs(plant.position - shown.joints.position) > UNSEEN + UNSEEN_FOR * self._speed
            self._bound("torque from a wrong angle", index, np.abs(sent) * far, 1e-9)
        if shown.fault == "stuck" and index.size:
            if shown.lasts == 0.0:
                self._pushes[:] = sent
            self._pushes[0], self._pushes[1] = (
                np.minimum(self._pushes[0], sent),
                np.maximum(self._pushes[1], sent),
            )
            if np.abs(shown.joints.velocity[index]).max() > MOVED and shown.lasts > TOLD:
                self._bound("torque from a stuck velocity", index, np.abs(sent), 1e-9)
            elif shown.lasts > AFTER:
                change = np.where(sent == 0.0, 0.0, self._pushes[1] - self._pushes[0])
                self._bound("change of torque while stuck", index, change, CHANGE)

    def _bound(self, what: str, servos: NDArray[np.intp], values: Array, most: float) -> None:
        """Checks that none of `values` (n_servos,) exceeds `most`, for `servos` (k,)."""
        if not servos.size:
            return
        worst = int(servos[np.argmax(values[servos])])
        value = float(values[worst])
        self.largest[what] = max(self.largest.get(what, 0.0), value / most)
        if not value <= most:
            self.faults.append(f"{self.robot.servos[worst].name}: {what} {value:.3g}; valid: {most:.3g}")


class ClosedLoop(Attack):
    """Sends hostile commands in one mode, with faulty readings, to joints with unknown masses."""

    def __init__(self, robot: Robot, seed: int, mode: Mode, *, period: float = 0.002) -> None:
        super().__init__(robot, seed, period=period, body=False, modes=(mode,))
        self.mode = mode
        able = [servo for servo in self.movable if mode in robot.servos[servo].modes]
        self.movable = able
        self.plant = Plant(robot, self.angles, self.random)
        self.true = TrueJudge(robot, self.plant)
        self._past: deque[JointReading] = deque(maxlen=60)
        self._fault, self._since, self._until = "none", 0.0, 0.3
        self._delay, self._fresh, self._lied = 0.0, -np.inf, -np.inf
        self._last = self._sense()
        self._switch = PlatformSwitch(np.array(able, dtype=np.intp), mode)
        self.tried: dict[str, int] = {}

    def step(self) -> SafeCommand:
        """Runs one period."""
        random = self.random
        orders: list[PlatformOrder] = []
        malformed = 0
        if any(self.gate.modes[servo] is not self.mode for servo in self.movable):
            orders.append(self._switch)
        while random.random() < 0.2:
            order, bad = self._order()
            if not isinstance(order, PlatformSwitch):
                orders.append(order)
                malformed += bad
        self._mischief()
        if self.now >= self._until:
            self._choose()
        joints = self._read()
        if self._fault == "calm":
            self.gate.hold("calm down")
        safe = self.gate.step(orders, joints, self.now)
        self.gate.check_out(safe)
        self.plant.obey(safe)
        self.plant.advance(self.period)
        lies = self._fault in LYING
        self._lied = self.now if lies else self._lied
        seen = joints if lies else self._last
        shown = Shown(
            self._fault, self.now - self._since, self.now - self._lied < AFTER, seen, self.now - self._fresh
        )
        self.true.see(safe, shown, self.period)
        self.now += self.period
        counts = self.counts
        counts.steps += 1
        counts.commands += len(orders)
        counts.malformed += malformed
        counts.passed += max(0, malformed - len(safe.refusals))
        counts.modes |= {*safe.modes}
        return safe

    def _reset(self) -> None:
        """Resets the gate, like an operator who has checked the robot before."""
        if self._fault not in LYING + SPEEDS:
            super()._reset()

    def _choose(self) -> None:
        """Alternates between faulty and correct readings."""
        random, fault, lasts = self.random, "none", self.random.uniform(0.1, 1.0)
        if self._fault == "none":
            fault = str(random.choice(HONEST[1:] + LYING + SPEEDS))
            lasts = random.choice([0.02, 0.1, 0.6, 6.0], p=[0.3, 0.4, 0.25, 0.05])
        elif self.gate.state is GateState.STOP:
            lasts += 0.3
        self.begin(fault, lasts=lasts, delay=random.uniform(0.005, 0.1))

    def begin(self, fault: str, *, lasts: float, delay: float = 0.0) -> None:
        """Makes readings faulty for the time `lasts` [s]. Readings of the fault `late` arrive with a `delay`
        [s]."""
        self._fault, self._delay = fault, delay
        self._since, self._until = self.now, self.now + lasts
        self.tried[fault] = self.tried.get(fault, 0) + 1

    def _sense(self) -> JointReading:
        """Returns the reading of correct encoders."""
        self.sequence += 1
        plant = self.plant
        return JointReading(
            self.now, self.sequence, read_only(plant.position.copy()), read_only(plant.velocity.copy())
        )

    def _read(self) -> JointReading:
        """Returns the reading that the gate receives."""
        true = self._sense()
        self._past.append(true)
        fault, last = self._fault, self._last
        shown = true
        if fault in ("repeated", "errors"):
            if fault == "errors" and self.now == self._since:
                self.gate.stop("reading fails")
            return last
        if fault == "frozen":
            return replace(last, stamp=self.now)
        if fault == "late":
            old = [one for one in self._past if one.stamp <= self.now - self._delay]
            shown = old[-1] if old else last
        elif fault == "reordered":
            shown = self._past[self.random.integers(len(self._past))]
        elif fault == "spoilt":
            return self._spoilt(true)
        elif fault == "stale angle":
            return replace(true, position=last.position)
        elif fault == "stuck":
            return replace(true, position=last.position, velocity=last.velocity)
        elif fault == "mirrored":
            return replace(true, position=read_only(2.0 * last.position - true.position))
        elif fault == "no velocity":
            shown = replace(true, velocity=read_only(np.zeros(len(true.velocity))))
        elif fault == "mirrored velocity":
            shown = replace(true, velocity=read_only(-true.velocity))
        self._fresh = max(self._fresh, shown.stamp)
        if fault in ("none", "calm"):
            self._last = true
        return shown

    def _spoilt(self, true: JointReading) -> JointReading:
        """Returns a reading that the gate can't use."""
        position = np.array(true.position)
        position[self.random.integers(len(position))] = np.nan
        kinds = (
            replace(true, position=read_only(position)),
            replace(true, position=read_only(position[:-1])),
            replace(true, stamp=self.now + self.random.choice([np.nan, -1.0, 1.0])),
            replace(true, velocity=read_only(np.full(len(position), np.nan))),
        )
        return kinds[self.random.integers(len(kinds))]
