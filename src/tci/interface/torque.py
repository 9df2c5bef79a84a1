"""Torque mode: what may be sent to a servo whose position nobody controls.

A torque has no reference that could be kept inside limits, so the servo is watched instead: the nearer
it is to a limit, or the faster it is, the more a braking torque takes the place of the one asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.frames import Array
from tci.interface.bounds import APPROACH, MARGIN
from tci.model.description import Robot

RISE = 0.02
"""Time [s] in which a torque may go from zero to its limit. Ours."""
BAND = 0.1
"""Share of the speed limit over which braking takes over, from the speed that a limit allows. Ours."""


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
        self.set_servos([])

    @property
    def servos(self) -> NDArray[np.intp]:
        """Indices (k,) of the servos in torque mode."""
        return self._servos.index

    def set_servos(self, servos: Sequence[int]) -> None:
        """Which servos are in torque mode, all with their limits; a new one starts at zero torque."""
        index = np.array(sorted(servos), dtype=np.intp)
        fresh = [servo for servo in servos if servo not in getattr(self, "_servos", _NONE).index]
        self._wanted[fresh] = self._sent[fresh] = 0.0
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

    def step(self, position: Array, velocity: Array) -> Array:
        """Torques (k,) [N m] to send now, from measured `position` and `velocity` (n_servos,).

        At rest far from limits it is what was asked for. A servo that is faster than it could stop
        before its limit, by what it may accelerate, is braked with up to its full torque; at or beyond
        a limit no torque leads outward. A velocity that is not finite counts as zero torque wanted.
        """
        s = self._servos
        if not s.index.size:
            return s.torque
        q, v, wanted = position[s.index], velocity[s.index], self._wanted[s.index]
        wanted = np.where(np.isfinite(v), wanted, 0.0)
        v = np.nan_to_num(v)
        room = np.maximum(np.where(v > 0.0, s.upper - q, q - s.lower), 0.0)
        # What is left of the way after this period counts.
        room = np.maximum(room - np.abs(v) * self._period, 0.0)
        most = np.minimum(s.velocity, np.sqrt(2.0 * APPROACH * s.acceleration * room))
        braking = np.clip((np.abs(v) - most) / (BAND * s.velocity), 0.0, 1.0)
        torque = (1.0 - braking) * wanted - braking * np.sign(v) * s.torque
        torque = np.where(q >= s.upper, np.minimum(torque, 0.0), torque)
        torque = np.where(q <= s.lower, np.maximum(torque, 0.0), torque)
        rise = s.torque * self._period / RISE
        before = self._sent[s.index]
        result: Array = np.clip(torque, before - rise, before + rise)
        # A torque that leads out of the limits is taken off at once, whatever the rise.
        result = np.where(q >= s.upper, np.minimum(result, 0.0), result)
        result = np.where(q <= s.lower, np.maximum(result, 0.0), result)
        self._sent[s.index] = result
        return result


_NONE = _Servos(np.zeros(0, dtype=np.intp), *(np.zeros(0) for _ in range(5)))
