"""Torque mode: what may be sent to a servo whose position nobody controls.

A torque has no reference that could be kept inside limits, so the servo is watched instead: the nearer
it is to a limit, or the faster it is, the more a braking torque takes the place of the one asked for.
Watching takes joint data: as that ages, every torque ends, the braking one too. A braking torque that stays
when its joint has come to rest drives it the other way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.interface.gate.bounds import APPROACH, MARGIN
from tci.interface.gate.limiter import CREEP
from tci.model.description import Robot

RISE = 0.02
"""Time [s] in which a torque may go from zero to its limit. Ours."""
BAND = 0.1
"""Share of the allowed speed over which braking takes over beyond it. Ours."""
SETTLE = 2.0
"""Speeds that could be taken away in this many times the delay are braked in proportion: with all its torque
a servo that rests at a limit would tremble with the noise of its velocity. Ours."""
CALMER, BOLDER, LEAST = 0.5, 1.5, 1.0 / 64.0
"""Factors of the braking torque: after it has turned a joint round, and after it has not; and the least one.
Assumed: a joint that is much lighter than its limits say would be thrown to and fro with all its torque."""
FADE = float(np.deg2rad(2.0))
"""Distance [rad] before a limit over which a torque towards it fades out. Ours."""


@dataclass(frozen=True, slots=True, eq=False)
class _Servos:
    """Limits of the servos in torque mode, each (k,)."""

    index: NDArray[np.intp]
    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array


class TorqueLimiter:
    """Limits the torques of all servos of a robot that are in torque mode."""

    def __init__(self, robot: Robot, period: float, *, speed_share: float) -> None:
        self._robot = robot
        self._period = period
        self._share = speed_share
        self._wanted = np.zeros(len(robot.servos))
        self._sent = np.zeros(len(robot.servos))
        self._given, self._trust = np.zeros(len(robot.servos)), 0.0
        self._calm, self._before = np.ones(len(robot.servos)), np.zeros(len(robot.servos))
        self._halts = False
        self.set_servos([])

    @property
    def servos(self) -> NDArray[np.intp]:
        """Indices (k,) of the servos in torque mode."""
        return self._servos.index

    def set_servos(self, servos: Sequence[int]) -> None:
        """Which servos are in torque mode, all with their limits; a new one starts at zero torque."""
        index = np.array(sorted(servos), dtype=np.intp)
        fresh = [servo for servo in servos if servo not in getattr(self, "_servos", _NONE).index]
        self._wanted[fresh] = self._sent[fresh] = self._given[fresh] = self._before[fresh] = 0.0
        self._calm[fresh] = 1.0
        limits = [self._robot.servos[servo].limits for servo in index]
        self._servos = _Servos(
            index=index,
            lower=np.array([limit.lower for limit in limits], dtype=float) + MARGIN,
            upper=np.array([limit.upper for limit in limits], dtype=float) - MARGIN,
            velocity=self._share * np.array([limit.velocity for limit in limits], dtype=float),
            acceleration=np.array([limit.acceleration for limit in limits], dtype=float),
            torque=np.array([limit.torque for limit in limits], dtype=float),
        )

    def ask(self, servos: NDArray[np.intp], torque: Array) -> Array:
        """Want `torque` (k,) [N m] from now on; returns it within the servos' limits."""
        limit = np.array([self._robot.servos[servo].limits.torque for servo in servos], dtype=float)
        self._wanted[servos] = np.clip(torque, -limit, limit)
        return self._wanted[servos]

    def relax(self, servos: NDArray[np.intp] | None = None) -> None:
        """Want no torque from some servos, or from all; braking goes on."""
        self._wanted[slice(None) if servos is None else servos] = 0.0

    def halt(self) -> None:
        """Want no torque, and brake any motion in the next step: what should stand still does not coast."""
        self.relax()
        self._halts = True

    def step(self, position: Array, velocity: Array, *, age: float = 0.0, trust: float = 1.0) -> Array:
        """Torques (k,) [N m] to send now, from `position` and `velocity` (n_servos,) measured `age` [s] ago.
        Call it once per period.

        At rest far from limits it is what was asked for, which rises within RISE. A servo that is faster
        than it could stop before its limit, by what it may accelerate, is braked at once with up to its
        full torque, in proportion where it is nearly at rest; near a limit a torque towards it fades out,
        and beyond there is none, but for a slow way back. A velocity that is not finite counts as no torque
        wanted. No torque is more than its share of `trust` (0..1), and what was lost rises again within RISE.
        """
        s = self._servos
        q, v, wanted = position[s.index], velocity[s.index], self._wanted[s.index]
        wanted = np.where(np.isfinite(v), wanted, 0.0)
        v = np.nan_to_num(v)
        above, below = np.maximum(s.upper - q, 0.0), np.maximum(q - s.lower, 0.0)
        # What is left of the way when this torque has worked counts, less what slow speeds take to settle.
        late = age + self._period
        slow = SETTLE * s.acceleration * late
        way = np.abs(v) * late + slow * SETTLE * late
        room = np.maximum(np.where(v > 0.0, above, below) - way, 0.0)
        fastest = s.velocity * np.where((q < s.lower) | (q > s.upper), CREEP, 1.0)
        most = np.minimum((1.0 - BAND) * fastest, np.sqrt(2.0 * APPROACH * s.acceleration * room))
        if self._halts:
            most, self._halts = np.zeros(len(most)), False
        braking = np.clip((np.abs(v) - most) / np.maximum(BAND * most, MARGIN), 0.0, 1.0)
        rise = s.torque * self._period / RISE
        before = self._sent[s.index]
        self._sent[s.index] = rising = trust * np.clip(wanted, before - rise, before + rise)
        wanted = rising * np.minimum(np.where(rising > 0.0, above, below) / FADE, 1.0)
        against = trust * self._calmed(v, braking) * np.clip(v / slow, -1.0, 1.0) * s.torque
        self._given[s.index] = result = (1.0 - braking) * wanted - braking * against
        self._trust = trust
        return result

    def again(self, *, trust: float) -> Array:
        """Torques (k,) [N m] of the last step, within a period from it; less where `trust` (0..1) is less."""
        index = self._servos.index
        if trust < self._trust:
            self._sent[index] *= trust / self._trust
            self._given[index] *= trust / self._trust
            self._trust = trust
        return self._given[index]

    def _calmed(self, v: Array, braking: Array) -> Array:
        """Share (k,) of the torque that brakes servos at speeds `v` (k,) [rad/s], by what it did to them."""
        index = self._servos.index
        before, share = self._before[index], self._calm[index]
        turned = (v * before < 0.0) & (braking > 0.0)
        told = np.where(turned, CALMER * share, BOLDER * share)
        share = np.where(v == before, share, np.clip(told, LEAST, 1.0))
        self._before[index], self._calm[index] = v, share
        return share


_NONE = _Servos(np.zeros(0, dtype=np.intp), *(np.zeros(0) for _ in range(5)))
