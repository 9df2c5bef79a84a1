"""The gate: the last step before the wire. No command passes that a limit forbids.

Order of checks: freshness of the joint data, mode, shape, finite values, known limits, position and
couplings (clamped and reported), then velocity, acceleration and jerk over time (ruckig).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tci.errors import CommandError, LinkError, TciError
from tci.frames import Array, read_only
from tci.interface.acceptance import check_command, check_limits, fault_of_reading
from tci.interface.bounds import MARGIN, Bounds, bounds_of
from tci.interface.limiter import Limiter
from tci.interface.safe_command import GateState as GateState
from tci.interface.safe_command import SafeCommand as SafeCommand
from tci.interface.safe_command import Seal
from tci.messages import JointReading, Mode, PlatformCommand
from tci.model.description import Robot


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


class Gate:
    """Turns commands into what may be written, one step per control period.

    A servo is under command from its first accepted command on, starting where it was measured. The
    commanded servos of one robot part, and of parts that couplings tie to it, move in the same time.
    """

    def __init__(
        self, robot: Robot, *, period: float, stale_after: float, settings: GateSettings | None = None
    ) -> None:
        """`period` of the control loop [s]; joint data older than `stale_after` [s] means hold.

        Raises TciError for times that are not above 0 and finite.
        """
        if not 0.0 < period < np.inf or not 0.0 < stale_after < np.inf:
            raise TciError(f"period {period} s, stale_after {stale_after} s; valid: above 0 and finite")
        self.robot = robot
        self.period = period
        self.stale_after = stale_after
        self.settings = settings or GateSettings()
        self.state = GateState.RUN
        self._seal = Seal(robot.name)
        self._issued: SafeCommand | None = None
        self._groups = _groups(robot)
        self._chains: dict[int, _Chain] = {}
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
        accepted does not raise, since the robot needs a next position all the same: it is refused
        whole, counted, and named in `refusals`; what was running goes on. An argument of another
        type is a mistake in the program and raises what Python raises.
        """
        self._steps += 1
        # A check of the following error, handed out against measured, would give its reason here too.
        reason = fault_of_reading(self.robot, joints, now, self.stale_after)
        if reason and self.state is GateState.RUN:
            self._holds += 1
        self.state = GateState.HOLD if reason else GateState.RUN
        for chain in self._chains.values():
            if reason:
                chain.limiter.halt()
            else:
                chain.look_outside(joints.position)
        refusals: list[str] = []
        clamped: list[str] = []
        shares: dict[Mode, dict[int, float]] = {Mode.STIFFNESS: {}, Mode.DAMPING: {}}
        for command in commands:
            try:
                if reason:
                    raise CommandError(f"holding: {reason}")
                check_command(self.robot, command)
                if command.mode is Mode.POSITION:
                    clamped += self._aim(command, joints.position)
                else:
                    clamped += self._set_share(command, shares[command.mode])
            except CommandError as error:
                refusals.append(str(error))
        self._refusals += len(refusals)
        servos: list[int] = []
        positions: list[Array] = []
        for chain in self._chains.values():
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
            reason=reason,
        )
        return self._issued

    def check_out(self, safe: SafeCommand) -> None:
        """For links: raises LinkError unless `safe` is the latest this gate made, and not yet written."""
        if self._issued is None or safe is not self._issued:
            raise LinkError(
                "not the latest command of this link's gate, or written before; "
                "valid: write(gate.step(...)), once per step"
            )
        self._issued = None

    def _aim(self, command: PlatformCommand, measured: Array) -> list[str]:
        """Give the servos new targets; says which were clamped. Raises CommandError, then none has one."""
        wanted = dict(zip(command.servos.tolist(), command.values.tolist(), strict=True))
        speeds = dict(zip(command.servos.tolist(), command.speed.tolist(), strict=True))
        for servo in wanted:
            check_limits(self.robot.servos[servo])
        chains = {
            group: self._chain(group, [servo for servo in wanted if self._group(servo) == group], measured)
            for group in dict.fromkeys(self._group(servo) for servo in wanted)
        }
        self._chains.update(chains)
        clamped = []
        for chain in chains.values():
            limiter = chain.limiter
            free = np.array([servo in wanted for servo in chain.servos])
            target = np.array([wanted.get(s, t) for s, t in zip(chain.servos, limiter.target, strict=True)])
            speed = np.array([speeds.get(s, v) for s, v in zip(chain.servos, limiter.speed, strict=True)])
            nearest = limiter.bounds.nearest(target, free)
            limiter.aim(nearest, speed)
            for place in np.flatnonzero(np.abs(target - nearest) > 2 * MARGIN):
                name = self.robot.servos[chain.servos[place]].name
                self._clamps[name] += 1
                asked, allowed = np.rad2deg([target[place], nearest[place]])
                clamped.append(f"{name}: {asked:.2f} degrees asked, clamped to {allowed:.2f}")
        return clamped

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

    def _group(self, servo: int) -> int:
        return self._groups[self.robot.servos[servo].robot_part]

    def _chain(self, group: int, servos: Sequence[int], measured: Array) -> _Chain:
        """The servos of a group under command, with `servos` among them. Raises CommandError."""
        old = self._chains.get(group)
        if old is not None and set(servos) <= set(old.servos):
            return old
        union = sorted({*servos, *(old.servos if old else ())})
        bounds, outside = bounds_of(self.robot, union, speed_share=self.settings.speed_share)
        limiter = Limiter(bounds, measured[union], self.period)
        if old is not None:
            limiter.take_over([union.index(servo) for servo in old.servos], old.limiter)
        chain = _Chain(union, limiter, bounds, outside)
        chain.look_outside(measured)
        return chain


@dataclass(frozen=True, slots=True, eq=False)
class _Chain:
    """Servos that move together."""

    servos: list[int]
    """Indices (n,) into `Robot.servos`."""
    limiter: Limiter
    """Moves them."""
    bounds: Bounds
    """What they may do while every servo outside is at zero."""
    outside: NDArray[np.float64]
    """Coefficients (m, n_servos) of servos outside, in the couplings that name one of these."""

    def look_outside(self, measured: Array) -> None:
        """A coupled servo that is not commanded with these counts where it is `measured` (n_servos,) now."""
        if self.outside.any():
            shift = self.outside @ measured
            self.limiter.bounds = replace(
                self.bounds,
                coupling_lower=self.bounds.coupling_lower - shift,
                coupling_upper=self.bounds.coupling_upper - shift,
            )


def _groups(robot: Robot) -> dict[str, int]:
    """A number for each robot part; parts that couplings tie together have the same one."""
    groups = {part: i for i, part in enumerate(dict.fromkeys(servo.robot_part for servo in robot.servos))}
    for coupling in robot.couplings:
        tied = {groups[robot.servos[servo].robot_part] for servo in coupling.servos}
        groups = {part: min(tied) if group in tied else group for part, group in groups.items()}
    return groups
