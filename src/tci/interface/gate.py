"""The gate: the last step before the wire. No command passes that a limit forbids.

Order of checks: freshness of the joint data, mode, shape, finite values, known limits, position and
couplings (clamped and reported), then velocity, acceleration and jerk over time (ruckig).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError, LinkError, TciError
from tci.frames import Array, read_only
from tci.interface.limiter import Bounds, Limiter
from tci.messages import JointReading, Mode, PlatformCommand
from tci.model.description import Robot, Servo

NEEDED = ("lower", "upper", "velocity", "acceleration", "jerk")
"""Limits without which no servo is moved."""


class GateState(Enum):
    """What the gate is doing."""

    RUN = "run"
    """Commands pass, within the limits."""
    HOLD = "hold"
    """Joint data is too old or not usable: stop, keep the position. Clears by itself."""


@dataclass(frozen=True, slots=True)
class GateSettings:
    """What the description does not say."""

    speed_share: float = 0.9
    """Share of a servo's speed limit that is commanded, since a real servo overshoots. Ours."""

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_share <= 1.0:
            raise TciError(f"speed_share {self.speed_share}; valid: above 0, at most 1")


@dataclass(frozen=True, slots=True)
class GateCounts:
    """What the gate did since it was made."""

    steps: int
    """Control periods."""
    holds: int
    """Times that it began to hold."""
    refusals: int
    """Commands that it refused whole."""
    clamps: Mapping[str, int]
    """Times that a servo's target was clamped, by servo name."""


@dataclass(frozen=True, slots=True)
class _Seal:
    """What only a gate has; without it no SafeCommand can be made."""

    robot: str


@dataclass(frozen=True, slots=True, eq=False)
class SafeCommand:
    """What may be written now. Only a gate makes it, for its own link, once."""

    seal: object = field(repr=False)
    stamp: float
    """When it was made [s]."""
    state: GateState
    """What the gate was doing."""
    servos: NDArray[np.intp]
    """Indices (k,) of servos that are under command; no other joint is ever sent anything."""
    position: Array
    """Where each of them should be at the end of this period (k,) [rad]."""
    stiffness: Mapping[int, float]
    """New share 0..1 of full stiffness, by servo index, where commanded."""
    damping: Mapping[int, float]
    """New share 0..1 of full damping, by servo index, where commanded."""
    clamped: tuple[str, ...]
    """Targets that were clamped, in words."""
    refusals: tuple[str, ...]
    """Commands that were refused, and why."""

    def __post_init__(self) -> None:
        if not isinstance(self.seal, _Seal):
            raise LinkError("only a gate makes a SafeCommand: use link.gate.step(...)")


class Gate:
    """Turns commands into what may be written, one step per control period.

    A servo is under command from its first accepted command on, starting where it was measured. The
    commanded servos of one robot part move in the same time.
    """

    def __init__(
        self, robot: Robot, *, period: float, stale_after: float, settings: GateSettings | None = None
    ) -> None:
        """`period` of the control loop [s]; joint data older than `stale_after` [s] means hold."""
        if not 0.0 < period < np.inf or not 0.0 < stale_after < np.inf:
            raise TciError(f"period {period} s, stale_after {stale_after} s; valid: above 0 and finite")
        self.robot = robot
        self.period = period
        self.stale_after = stale_after
        self.settings = settings or GateSettings()
        self.state = GateState.RUN
        self._seal = _Seal(robot.name)
        self._issued: SafeCommand | None = None
        self._chains: dict[str, _Chain] = {}
        self._steps = self._holds = self._refusals = 0
        self._clamps: Counter[str] = Counter()

    @property
    def counts(self) -> GateCounts:
        """What happened since the gate was made."""
        clamps = MappingProxyType(dict(self._clamps))
        return GateCounts(self._steps, self._holds, self._refusals, clamps)

    @property
    def targets(self) -> Array:
        """Where the servos under command are going [rad], in the order of `SafeCommand.servos`."""
        return np.concatenate([chain.limiter.target for chain in self._chains.values()] or [np.zeros(0)])

    def step(self, commands: Sequence[PlatformCommand], joints: JointReading, now: float) -> SafeCommand:
        """What may be written at time `now` [s], given new `commands` and the latest `joints`.

        Call it once per period, also without commands: motions go on. A command that can't be
        accepted is refused whole, counted, and named in `refusals`; what was running goes on.
        """
        self._steps += 1
        reason = self._unusable(joints, now)
        if reason and self.state is GateState.RUN:
            self._holds += 1
        self.state = GateState.HOLD if reason else GateState.RUN
        for chain in self._chains.values():
            if chain.loose and not reason:
                chain.limiter.bounds = self._bounds(chain.servos, joints)
        refusals, clamped = [], []
        shares: dict[Mode, dict[int, float]] = {Mode.STIFFNESS: {}, Mode.DAMPING: {}}
        for command in commands:
            try:
                if reason:
                    raise CommandError(f"holding: {reason}")
                self._check(command)
                if command.mode is Mode.POSITION:
                    clamped += self._aim(command, joints)
                else:
                    clamped += self._set_share(command, shares[command.mode])
            except CommandError as error:
                refusals.append(str(error))
        self._refusals += len(refusals)
        servos: list[int] = []
        positions: list[Array] = []
        for chain in self._chains.values():
            if reason:
                chain.limiter.halt()
            servos += chain.servos
            positions.append(chain.limiter.step())
        self._issued = SafeCommand(
            seal=self._seal,
            stamp=now,
            state=self.state,
            servos=read_only(servos, np.intp),
            position=read_only(np.concatenate(positions) if positions else []),
            stiffness=MappingProxyType(shares[Mode.STIFFNESS]),
            damping=MappingProxyType(shares[Mode.DAMPING]),
            clamped=tuple(clamped),
            refusals=tuple(refusals),
        )
        return self._issued

    def check_out(self, safe: SafeCommand) -> None:
        """For links: raises LinkError unless `safe` is the latest this gate made, and not yet written."""
        if safe is not self._issued:
            raise LinkError(
                "not the latest command of this link's gate, or written before; "
                "valid: write(gate.step(...)), once per step"
            )
        self._issued = None

    def _unusable(self, joints: JointReading, now: float) -> str:
        """Why the joint data can't be used; empty when it can."""
        expected = (len(self.robot.servos),)
        if joints.position.shape != expected:
            return f"joint reading of shape {joints.position.shape}; valid: {expected}"
        if not np.isfinite(joints.position).all():
            bad = self.robot.servos[int(np.argmin(np.isfinite(joints.position)))].name
            return f"the angle of {bad} is not finite"
        age = now - joints.stamp
        if not -self.stale_after <= age <= self.stale_after:  # also refuses NaN
            return f"joint data is {age * 1e3:.0f} ms old; valid: at most {self.stale_after * 1e3:.0f} ms"
        return ""

    def _check(self, command: PlatformCommand) -> None:
        """Raises CommandError for a mode, shape or value that can't be accepted."""
        if command.mode not in (Mode.POSITION, Mode.STIFFNESS, Mode.DAMPING):
            raise CommandError(
                f"mode {command.mode.value} has no gate yet; valid: position, stiffness, damping"
            )
        servos, count = command.servos, len(self.robot.servos)
        if servos.ndim != 1 or not servos.size or command.values.shape != servos.shape:
            raise CommandError(
                f"{command.mode.value}: {servos.shape} servos and {command.values.shape} values; "
                "valid: as many values as servos, at least one"
            )
        if command.speed.shape != servos.shape or not np.all(command.speed > 0.0):
            raise CommandError(
                f"speed {command.speed} rad/s; valid: one above 0 for each of {servos.size} servos"
            )
        if not np.issubdtype(servos.dtype, np.integer) or servos.min() < 0 or servos.max() >= count:
            raise CommandError(f"servos {servos.tolist()}; valid: 0 to {count - 1}")
        if len(set(servos.tolist())) != servos.size:
            raise CommandError(f"servos {servos.tolist()}; valid: each only once")
        for servo, value in zip(servos, command.values, strict=True):
            if not np.isfinite(value):
                raise CommandError(
                    f"{command.mode.value} of {self.robot.servos[servo].name} is {value}; "
                    "valid: finite numbers"
                )

    def _aim(self, command: PlatformCommand, joints: JointReading) -> list[str]:
        """Give the servos new targets; says which were clamped."""
        wanted = dict(zip(command.servos.tolist(), command.values.tolist(), strict=True))
        speeds = dict(zip(command.servos.tolist(), command.speed.tolist(), strict=True))
        for servo in wanted:
            self._check_limits(self.robot.servos[servo])
        clamped = []
        for name in dict.fromkeys(self.robot.servos[servo].robot_part for servo in wanted):
            chain = self._chain(name, [s for s in wanted if self.robot.servos[s].robot_part == name], joints)
            limiter = chain.limiter
            target = np.array([wanted.get(s, t) for s, t in zip(chain.servos, limiter.target, strict=True)])
            speed = np.array([speeds.get(s, v) for s, v in zip(chain.servos, limiter.speed, strict=True)])
            nearest = limiter.bounds.nearest(target)
            limiter.aim(nearest, speed)
            for servo, asked, allowed in zip(chain.servos, target, nearest, strict=True):
                if servo in wanted and abs(asked - allowed) > 2e-6:
                    clamped.append(self._clamp_message(self.robot.servos[servo], asked, allowed))
        return clamped

    def _clamp_message(self, servo: Servo, asked: float, allowed: float) -> str:
        self._clamps[servo.name] += 1
        asked, allowed = np.rad2deg([asked, allowed])
        return f"{servo.name}: {asked:.2f} degrees asked, clamped to {allowed:.2f}"

    def _check_limits(self, servo: Servo) -> None:
        missing = [name for name in NEEDED if getattr(servo.limits, name) is None]
        if missing:
            raise CommandError(
                f"{servo.name} can't be moved: its description has no limit of {', '.join(missing)}"
            )

    def _set_share(self, command: PlatformCommand, shares: dict[int, float]) -> list[str]:
        """Stiffness or damping: shares 0..1, clamped and reported."""
        clamped = []
        for servo, value in zip(command.servos.tolist(), command.values.tolist(), strict=True):
            shares[servo] = min(max(value, 0.0), 1.0)
            if shares[servo] != value:
                name = self.robot.servos[servo].name
                self._clamps[name] += 1
                clamped.append(f"{name}: {command.mode.value} {value:g} asked, clamped to {shares[servo]:g}")
        return clamped

    def _chain(self, robot_part: str, servos: Sequence[int], joints: JointReading) -> _Chain:
        """The servos of a robot part under command, with `servos` among them."""
        old = self._chains.get(robot_part)
        if old is not None and set(servos) <= set(old.servos):
            return old
        union = sorted({*servos, *(old.servos if old else ())})
        limiter = Limiter(self._bounds(union, joints), joints.position[union], self.period)
        if old is not None:
            places = [union.index(servo) for servo in old.servos]
            limiter.take_over(places, old.limiter.state, old.limiter.target, old.limiter.speed)
        loose = any({*union} & {*c.servos} and not {*c.servos} <= {*union} for c in self.robot.couplings)
        self._chains[robot_part] = _Chain(union, limiter, loose)
        return self._chains[robot_part]

    def _bounds(self, servos: Sequence[int], joints: JointReading) -> Bounds:
        limits = [self.robot.servos[servo].limits for servo in servos]
        rows, lower, upper = [], [], []
        for coupling in self.robot.couplings:
            terms = dict(zip(coupling.servos, coupling.coefficients, strict=True))
            if not terms.keys() & set(servos):
                continue
            # A coupled servo that is not commanded with these counts where it is measured now.
            still = sum(c * joints.position[s] for s, c in terms.items() if s not in servos)
            rows.append([terms.get(servo, 0.0) for servo in servos])
            lower.append(coupling.lower - still)
            upper.append(coupling.upper - still)
        return Bounds(
            lower=np.array([limit.lower for limit in limits], dtype=float),
            upper=np.array([limit.upper for limit in limits], dtype=float),
            velocity=self.settings.speed_share * np.array([limit.velocity for limit in limits], dtype=float),
            acceleration=np.array([limit.acceleration for limit in limits], dtype=float),
            jerk=np.array([limit.jerk for limit in limits], dtype=float),
            coupling=np.array(rows, dtype=float).reshape(-1, len(servos)),
            coupling_lower=np.array(lower, dtype=float),
            coupling_upper=np.array(upper, dtype=float),
        )


@dataclass(slots=True)
class _Chain:
    """Servos of one robot part that move together."""

    servos: list[int]
    """Indices into `Robot.servos`."""
    limiter: Limiter
    """Moves them."""
    loose: bool
    """A coupling ties them to a servo outside, whose angle has to be looked at in every step."""
