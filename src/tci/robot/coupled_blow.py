"""How hard a robot strikes if each joint bends by itself.

`tci.robot.blow` takes all that is behind a place for one mass on one spring, since a pace is found many times
a second. Here each joint has its own servo and its own most torque: a weak one gives way while others push,
links behind a soft joint follow later, and a place that bounced off may come back with more force. Posture
and direction are those of the first touch. A motor's inertia and a servo's stiffness do not change with the
posture: they go by the largest inertia that a joint ever carries.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array, read_only
from tci.robot.blow import BANDWIDTH, ROTOR, Struck
from tci.robot.description import Robot
from tci.robot.dynamics import inertia_range
from tci.robot.kernels.coupled_blow import Carried, coupled_peak


class Motors:
    """The motors and servos of a robot, in the order of `Robot.servos`."""

    def __init__(self, robot: Robot) -> None:
        """Raises the errors that `Dynamics` raises."""
        carried = inertia_range(robot).largest.diagonal()
        self.acceleration = read_only([servo.limits.acceleration or 20.0 for servo in robot.servos])
        """(n_servos,) [rad/s2] at most."""
        self.rotor = read_only(ROTOR * carried)
        """(n_servos,) [kg m2] at the joints."""
        self.stiffness = read_only((1.0 + ROTOR) * carried * BANDWIDTH**2)
        """(n_servos,) [N m/rad]."""
        self.damping = read_only(2.0 / BANDWIDTH * self.stiffness)
        """(n_servos,) [N m s/rad]."""
        given = [servo.limits.torque or 0.0 for servo in robot.servos]
        # a servo has at least the torque that its acceleration limit needs
        self.torque = read_only(np.maximum(given, (1.0 + ROTOR) * carried * self.acceleration))
        """(n_servos,) [N m] at most."""

    def behind(self, inertia: Array, moved: Array) -> Coupled | None:
        """What is behind a place that servo speeds move by `moved` (n_servos,) [m/rad] along the direction of
        the blow. `inertia` (n_servos, n_servos) [kg m2] is that of the links. None if no servo moves the
        place."""
        moves = (np.abs(moved) > 1e-6) & (inertia.diagonal() > 0.0)
        if not moves.any():
            return None
        joints = np.flatnonzero(np.abs(inertia[moves]).max(axis=0) > 0.0)  # those that feel a blow
        gives = np.linalg.inv(inertia[np.ix_(joints, joints)] + np.diag(self.rotor[joints]))
        per_joint = self.stiffness, self.damping, self.torque, self.acceleration, moved
        return Coupled(joints, Carried(read_only(gives), *[read_only(one[joints]) for one in per_joint]))


@dataclass(frozen=True, slots=True, eq=False)
class Coupled:
    """What is behind one place of a robot, along one direction."""

    joints: NDArray[np.intp]
    """Servos (n,) that move the place, or that its blow moves."""
    carried: Carried

    @property
    def mass(self) -> float:
        """Effective mass [kg] of links and motors."""
        return float(1.0 / (self.carried.moved @ self.carried.gives @ self.carried.moved))

    @property
    def stall(self) -> float:
        """Force [N] at which the first servo has its most torque."""
        lever = np.abs(self.carried.moved)
        return float((self.carried.torque[lever > 1e-6] / lever[lever > 1e-6]).min())

    def force_on(self, struck: Struck, velocity: Array, *, reaction: float) -> float:
        """Largest force [N] of a blow at servo speeds `velocity` (n_servos,) [rad/s], noticed `reaction` [s]
        after the first touch."""
        rates, room = read_only(velocity[self.joints]), np.empty((5, len(self.joints)))
        peak = coupled_peak(self.carried, rates, struck.stiffness, struck.mass, reaction, room)
        return float(peak)
