"""Hostile commands in every mode on any robot, and a judge that shares no code with the gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError
from tci.gate.acceptance import SLOWEST
from tci.gate.gate import Gate, GateSettings, GateState, SafeCommand
from tci.messages import CONTROL_MODES, JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position

AHEAD = 0.02
"""Time [s] for which the robots receive references in advance."""
REST_IN = 3.0
"""Time [s] within which a robot that holds or has stopped must come to rest."""
BUSY, CYCLE = 700, 1500
"""Number of steps with commands, and number of steps from one rest to the next."""
WIGGLE = 2e-3
"""Distance [rad] by which a stop may move outwards again while a joint returns from outside its bounds."""
FAST = 0.1
"""Speed [rad/s] above which a servo that changes its mode counts as moving."""
STILL = 1e-9
"""Largest distance [rad] between two readings with equal time stamps of a joint at rest."""
SAG = float(np.deg2rad(0.4))
"""Distance [rad] between a simulated servo and its reference."""


class Judge:
    """Checks each output against the limits: position, velocity, acceleration, jerk, couplings, torque."""

    def __init__(self, robot: Robot, period: float) -> None:
        self.robot, self.period = robot, period
        count = len(robot.servos)
        limits = [servo.limits for servo in robot.servos]
        self.lower = np.array([np.nan if x.lower is None else x.lower for x in limits])
        self.upper = np.array([np.nan if x.upper is None else x.upper for x in limits])
        rates = [(x.velocity, x.acceleration, x.jerk) for x in limits]
        self.rates = np.array([[np.nan if r is None else r for r in rate] for rate in rates]).T
        self.torque = np.array([0.0 if x.torque is None else x.torque for x in limits])
        self.steps = np.zeros((4, count))
        self.read: tuple[Array, Array] = np.zeros(count), np.zeros(count)
        self.began, self.pace = np.zeros(count, dtype=bool), np.zeros(count)
        # Least distance by which each servo was outside its bounds since it was first commanded. `values`
        # contains this distance for each coupling.
        self.outside = np.full(count, np.nan)
        self.modes: list[Mode | None] = [None] * count
        self.values = np.full(len(robot.couplings), np.nan)
        self.still = 0
        self.peak = -np.inf
        """Largest excess over a limit: for rates and torque as a fraction of the limit, for positions in
        rad."""
        self.faults: list[str] = []

    def forget(self) -> None:
        """Records that an operator has reset the gate: every servo starts again at its measured angle."""
        self.modes = [None] * len(self.modes)

    def see(
        self, safe: SafeCommand, measured: Array, *, moved: bool = True, speed: Array | None = None
    ) -> None:
        """Checks the output of one step. `measured` (n,) [rad] and `speed` (n,) [rad/s], by default 0, are
        the robot's state before the step. `moved` is True if a step was due."""
        speed = np.zeros(len(measured)) if speed is None else speed
        if moved:
            self.read = measured, speed
        measured, speed = self.read  # of two readings with one stamp the first counts
        sent = np.full(len(measured), np.nan)
        sent[safe.servos] = safe.position
        for name in ("position", "velocity", "torque"):
            if not np.isfinite(getattr(safe, name)).all():
                self._fault(f"{name} is not finite", np.inf)
                return
        told = [(s, m) for s, m in zip(safe.servos.tolist(), safe.modes, strict=True) if m is not Mode.TORQUE]
        modes: list[Mode | None] = [None] * len(self.modes)
        starts = np.zeros(len(self.modes), dtype=bool)
        for servo, mode in told:
            modes[servo] = mode
            was = self.modes[servo]
            yielded = was is Mode.IMPEDANCE and mode is not Mode.IMPEDANCE
            if was is None or (yielded and not self._goes_on(servo, sent[servo], measured[servo])):
                starts[servo] = True
                self.steps[:, servo] = self._run_up(servo, sent[servo], measured, speed)
                self.outside[servo] = np.nan
                self.values[:] = np.nan
        left = any(a is not None and b is None for a, b in zip(self.modes, modes, strict=True))
        if left:
            self.values[:] = np.nan
        self.modes = modes
        index = np.array([servo for servo, _ in told], dtype=np.intp)
        loose = np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)
        position = safe.position[~loose]
        if not moved:
            if (np.abs(position - self.steps[3, index]) > STILL * starts[index]).any():
                self._fault("moved before its time", np.inf)
            self.began |= starts
            self.pace[starts] = speed[starts]
            return
        for servo in np.flatnonzero(
            self.began & ~starts & np.isfinite(sent)
        ).tolist():  # only now it shows at which speed
            self.steps[:, servo] = self._run_up(servo, sent[servo], self.steps[3], self.pace)
        self.began[:] = False
        self.steps[:-1] = self.steps[1:].copy()
        self.steps[3, index] = position
        untold = np.ones(len(self.modes), dtype=bool)
        untold[index] = False
        self.steps[:, untold] = measured[untold]
        self._position(index)
        self._rates(index)
        over = np.abs(safe.torque) - self.torque[safe.servos]
        self._note("torque", safe.servos, over)
        if safe.torque[~loose].any():
            self._fault("torque outside torque mode", np.inf)
        self._couplings(safe, set(safe.servos[loose].tolist()))
        self._rest(safe)

    def _goes_on(self, servo: int, sent: float, measured: float) -> bool:
        """True if a compliant servo that gets another mode goes on from its reference. Otherwise it must go
        on from its measured state."""
        if abs(sent - self.steps[3, servo]) <= STILL:  # as in a step that was not due
            return True
        if abs(sent - measured) <= STILL:
            return False
        steps = np.append(self.steps[1:, servo], sent)
        rates = [abs(np.diff(steps, order)[-1]) / self.period**order for order in (1, 2, 3)]
        return bool((np.array(rates) <= self.rates[:, servo] * (1.0 + 1e-6)).all())

    def _run_up(self, servo: int, sent: float, measured: Array, speed: Array) -> Array:
        """Returns the last angles (4,) [rad] of a servo that gets its first reference, as if it had moved
        evenly. It may start at any speed between rest and its measured speed."""
        first = (sent - measured[servo]) / self.period
        pace = min(max(first, min(speed[servo], 0.0)), max(speed[servo], 0.0))
        angles: Array = measured[servo] + pace * self.period * np.arange(-3.0, 1.0)
        return angles

    def see_ahead(self, safe: SafeCommand, ahead: Array, time: float) -> None:
        """Checks the positions that are predicted for `time` [s] later. Drivers send these to robots that
        need their path in advance."""
        asked = np.array([mode in (Mode.POSITION, Mode.IMPEDANCE) for mode in safe.modes], dtype=bool)
        index, now, ahead = safe.servos[asked], safe.position[asked], ahead[asked]
        outside = self._outside(index, ahead)
        # For a servo that was first commanded in a period that was not due, `outside` is not set yet.
        least = np.fmin(self._outside(index, now), self.outside[index])
        self._note("position ahead", index, outside - np.where(least > 0.0, least + WIGGLE, 0.0))
        self._note("way ahead", index, np.abs(ahead - now) - self.rates[0, index] * time)

    def _position(self, index: NDArray[np.intp]) -> None:
        outside = self._outside(index, self.steps[3, index])
        least = self.outside[index] = np.fmin(outside, self.outside[index])
        self._note("position", index, outside - np.where(least > 0.0, least + WIGGLE, 0.0))

    def _outside(self, index: NDArray[np.intp], position: Array) -> Array:
        """Returns the distance (k,) [rad] of servos at `position` (k,) [rad] outside their limits."""
        beyond = np.maximum(position - self.upper[index], self.lower[index] - position)
        return np.maximum(beyond, 0.0)

    def _rates(self, index: NDArray[np.intp]) -> None:
        steps = differences = self.steps[:, index]
        largest = np.spacing(np.abs(steps).max(axis=0))
        for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
            differences = differences[1:] - differences[:-1]
            bound = self.rates[order - 1, index]
            value = np.abs(differences[-1]) / self.period**order
            # Angles of a few rad are rounded to 4e-16. In a third difference divided by the period cubed,
            # this error is larger.
            rounding = 2.0 ** (order + 1) * largest / self.period**order
            self._note(name, index, (value - rounding - bound) / bound)

    def _couplings(self, safe: SafeCommand, loose: set[int]) -> None:
        for row, coupling in enumerate(self.robot.couplings):
            servos = list(coupling.servos)
            if loose & set(servos) or not set(servos) & set(safe.servos.tolist()):
                self.values[row] = np.nan
                continue
            value = float(self.steps[3, servos] @ np.array(coupling.coefficients))
            outside = max(value - coupling.upper, coupling.lower - value, 0.0)
            least = min(outside, self.values[row]) if np.isfinite(self.values[row]) else outside
            self.values[row] = least
            excess = outside - (least + WIGGLE if least > 0.0 else 0.0)
            self._note(coupling.name, np.array(servos[:1]), np.array([excess]))

    def _rest(self, safe: SafeCommand) -> None:
        self.still = 0 if safe.state is GateState.RUN else self.still + 1
        if self.still * self.period > REST_IN and np.abs(safe.velocity).max(initial=0.0) > 1e-9:
            self._fault(f"in {safe.state.value} and not at rest", np.inf)

    def _note(self, what: str, servos: NDArray[np.intp], excess: Array) -> None:
        if not excess.size:
            return
        most = float(excess.max())
        if -np.inf < most <= 1e-6 and excess.min() > -np.inf:
            self.peak = max(self.peak, most)
            return
        worst = int(np.argmax(excess)) if np.isfinite(excess).all() else int(np.argmax(~np.isfinite(excess)))
        value = float(excess[worst]) if np.isfinite(excess[worst]) else np.inf
        self.peak = max(self.peak, value)
        if not value <= 1e-6:
            self._fault(f"{self.robot.servos[servos[worst]].name}: {what}", value)

    def _fault(self, words: str, excess: float) -> None:
        self.faults.append(f"{words} exceeded by {excess:.3g}")


@dataclass
class Counts:
    """Numbers of commands that the attacker has sent."""

    steps: int = 0
    commands: int = 0
    malformed: int = 0
    """Number of commands that must be refused."""
    passed: int = 0
    """Number of malformed commands that the gate did not refuse."""
    states: dict[str, int] = field(default_factory=dict)
    modes: set[Mode] = field(default_factory=set)
    """Control modes in which the gate has sent a command."""


class Attack:
    """A gate, a robot that follows the gate, and an attacker."""

    eager = 0.2
    """Probability that the attacker sends another command in a step."""
    cycle = CYCLE

    def __init__(
        self,
        robot: Robot,
        seed: int,
        *,
        period: float = 0.002,
        body: bool = True,
        modes: Sequence[Mode] = CONTROL_MODES,
        streams: bool = True,
    ) -> None:
        """Starts an attack. `body` turns on the check for self-collision. `modes` are the modes to which the
        attacker switches, in motion if `streams` is True."""
        settings = GateSettings() if body else GateSettings(self_collision=None)
        self.robot, self.period, self.modes = robot, period, modes
        self.gate = Gate(robot, period=period, stale_after=0.05, settings=settings, streams=streams)
        self.judge = Judge(robot, period)
        self.random = np.random.default_rng(seed)
        self.counts = Counts()
        self.now, self.sequence = 0.0, 0
        self.switched = 0
        """Number of changes of mode of servos in motion."""
        self._modes: dict[int, Mode] = {}
        self.angles = np.array(initial_position(robot), dtype=float)
        self.speeds = np.zeros(len(self.angles))
        self.movable = [s.index for s in robot.servos if None not in (s.limits.lower, s.limits.jerk)]
        self.sag = self.random.uniform(-SAG, SAG, len(self.angles))
        limits = [servo.limits for servo in robot.servos]
        self._torque = np.array([x.torque or 0.0 for x in limits])
        self._inertia = np.array([(x.torque or 1.0) / (x.acceleration or 1.0) for x in limits])

    def step(self) -> SafeCommand:
        """Runs one period with a random attack."""
        random, gate = self.random, self.gate
        orders: list[PlatformOrder] = []
        malformed = 0
        time = self.counts.steps % self.cycle
        if time == BUSY:
            gate.hold("calm down")
        if time == self.cycle - 1:
            orders = self._switches()
        while time < BUSY and random.random() < self.eager:
            order, bad = self._order()
            orders.append(order)
            malformed += bad
        self._mischief()
        safe = self._pass(orders, malformed, self.now)
        self.counts.steps += 1
        if random.random() < 0.002:
            when = random.choice([self.now, self.now, np.nan, np.inf, -np.inf, self.now - 1.0])
            # If time decreases, the gate stops the robot, and the stop begins immediately.
            order, bad = self._order()
            self._pass([order], int(bad), when, moved=bool(-np.inf < when < self.now))
        self.now += self.period
        if random.random() < 0.001:
            self.now += self.period * random.integers(1, 40)
        return safe

    def _pass(
        self, orders: Sequence[PlatformOrder], malformed: int, when: float, *, moved: bool = True
    ) -> SafeCommand:
        """Sends orders, some of them malformed, to the gate. The judge checks the output, and the robot
        executes it."""
        before, speed = self.angles.copy(), self.speeds.copy()
        safe = self.gate.step(orders, self._reading(), when)
        self.gate.check_out(safe)
        self.switched += self._count_switches(safe, speed)
        self._see(safe, before, speed, moved)
        counts = self.counts
        counts.modes |= {*safe.modes}
        counts.commands += len(orders)
        counts.malformed += malformed
        counts.passed += max(0, malformed - len(safe.refusals))
        counts.states[safe.state.value] = counts.states.get(safe.state.value, 0) + 1
        self._obey(safe)
        return safe

    def _count_switches(self, safe: SafeCommand, speed: Array) -> int:
        """Returns how many moving servos have changed their mode in this step."""
        modes = dict(zip(safe.servos.tolist(), safe.modes, strict=True))
        changed = [servo for servo, mode in modes.items() if self._modes.get(servo, mode) is not mode]
        self._modes = modes
        return int(np.count_nonzero(np.abs(speed[changed]) > FAST))

    def _see(self, safe: SafeCommand, before: Array, speed: Array, moved: bool) -> None:
        self.judge.see(safe, before, moved=moved, speed=speed)
        self.judge.see_ahead(safe, self.gate.ahead(AHEAD), AHEAD)

    def _obey(self, safe: SafeCommand) -> None:
        loose = np.array([mode is Mode.TORQUE for mode in safe.modes], dtype=bool)
        told = safe.servos[~loose]
        resting = np.ones(len(self.speeds), dtype=bool)
        resting[safe.servos[loose]] = False
        self.speeds[resting] = 0.0
        self.speeds[told] = safe.velocity[~loose]
        self.angles[told] = safe.position[~loose] + self.sag[told]
        free = safe.servos[loose]
        for _ in range(4 if free.size else 0):
            self.speeds[free] += safe.torque[loose] / self._inertia[free] * self.period / 4
            self.angles[free] += self.speeds[free] * self.period / 4

    def _reading(self) -> JointReading:
        self.sequence += 1
        random = self.random
        stamp, position, velocity = self.now, self.angles, self.speeds
        if random.random() < 0.0005:
            spoilt = random.integers(4)
            if spoilt == 0:
                position = position.copy()
                position[random.integers(len(position))] = random.choice([np.nan, np.inf])
            elif spoilt == 1:
                stamp = random.choice([np.nan, self.now - 1.0, self.now + 1.0])
            elif spoilt == 2:
                position = position[:-1]
            else:
                velocity = np.full(len(position), np.nan)
        return JointReading(stamp, self.sequence, read_only(position), read_only(velocity))

    def _mischief(self) -> None:
        random, gate = self.random, self.gate
        if random.random() < 0.0005:
            gate.stop("the attacker says so")
        if random.random() < 0.001:
            gate.hold("the attacker says so")
        if (gate.state is GateState.STOP and random.random() < 0.01) or random.random() < 0.0005:
            self._reset()

    def _reset(self) -> None:
        try:
            self.gate.reset()
        except CommandError:
            return  # the robot still moves
        self.judge.forget()

    def _order(self) -> tuple[PlatformOrder, bool]:
        """Returns an order, and True if it must be refused."""
        random, robot = self.random, self.robot
        count = int(random.integers(1, min(8, len(self.movable)) + 1))
        servos = random.choice(self.movable, count, replace=False)
        if random.random() < 0.15:
            mode = self.modes[random.integers(len(self.modes))]
            able = [s for s in self.movable if mode in robot.servos[s].modes]
            if able:
                servos = random.permutation(able)[: random.integers(1, len(able) + 1)]
            return PlatformSwitch(np.array(servos, dtype=np.intp), mode), False
        mode = self.gate.modes[servos[0]] if random.random() < 0.9 else list(Mode)[random.integers(len(Mode))]
        if random.random() < 0.9:
            servos = np.array([s for s in servos if self.gate.modes[s] is mode] or servos)
        values = self._values(mode, servos)
        speed = np.full(len(servos), random.choice([SLOWEST, 0.05, 0.5, np.inf]))
        bad = random.random() < 0.03
        if bad:
            servos, values, speed = self._spoil(servos, values, speed)
        return PlatformCommand(mode, servos, values, speed), bad

    def _switches(self) -> list[PlatformOrder]:
        """Returns mode switches at rest. Each servo is switched to one of its modes. Then some servos are
        switched to another mode in the same step."""
        random, servos = self.random, self.robot.servos
        able = {s: [mode for mode in servos[s].modes if mode in self.modes] for s in self.movable}
        wanted = {s: modes[random.integers(len(modes))] for s, modes in able.items()}
        orders: list[PlatformOrder] = []
        for mode in (*CONTROL_MODES, *CONTROL_MODES):
            if chosen := [s for s in self.movable if wanted[s] is mode]:
                orders.append(PlatformSwitch(np.array(chosen, dtype=np.intp), mode))
            if mode is CONTROL_MODES[-1]:
                wanted = {s: servos[s].modes[0] for s in self.movable}
        return orders

    def _values(self, mode: Mode, servos: NDArray[np.intp]) -> Array:
        random, judge = self.random, self.judge
        if random.random() < 0.03:
            return random.choice([1e300, -1e300, 1e9, -1e-320, 0.0], len(servos))
        if mode is Mode.VELOCITY:
            return random.uniform(-1.5, 1.5, len(servos)) * judge.rates[0, servos]
        if mode is Mode.TORQUE:
            return random.uniform(-1.5, 1.5, len(servos)) * self._torque[servos]
        if mode in (Mode.STIFFNESS, Mode.DAMPING):
            return random.uniform(-1.0, 2.0, len(servos))
        return random.uniform(1.5 * judge.lower[servos] - 0.2, 1.5 * judge.upper[servos] + 0.2)

    def _spoil(
        self, servos: NDArray[np.intp], values: Array, speed: Array
    ) -> tuple[NDArray[np.intp], Array, Array]:
        random = self.random
        place = random.integers(len(servos))
        servos, values, speed = np.array(servos), values.copy(), speed.copy()
        match random.integers(9):
            case 0 | 1:
                values[place] = random.choice([np.nan, np.inf, -np.inf])
            case 2:
                speed[place] = random.choice([np.nan, -1.0, 0.0, 0.9 * SLOWEST, -np.inf])
            case 3:
                values = values[:-1]
            case 4:
                servos[place] = random.choice([-1, len(self.angles), 10**6])
            case 5:
                servos, values = np.append(servos, servos[0]), np.append(values, values[0])
                speed = np.append(speed, speed[0])
            case 6:
                values = values.reshape(1, -1)
            case 7:
                servos = servos.astype(float)
            case 8:
                values = values.astype(complex)
        return servos, values, speed
