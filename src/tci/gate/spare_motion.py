"""A motion that is planned and never sent. It keeps the code and data of motions in the processor's caches,
so that the next real motion is not delayed."""

from __future__ import annotations

import numpy as np

from tci.gate.immovable import is_movable
from tci.gate.joint_group import groups_of, make_chain
from tci.robot.description import Robot


class SpareMotion:
    """Motion of one group of servos, which nobody reads and no servo follows.

    A motion runs code and reads memory that a robot at rest does not use, so both leave the processor's
    caches. The first motion of a process therefore takes 0.4 ms longer than later motions, and a motion after
    200 periods without a command takes 30 us longer. Steps of the spare motion keep code and memory in the
    caches.
    """

    def __init__(self, robot: Robot, *, period: float, speed_share: float) -> None:
        """Prepares a motion of the first group of servos with known limits. One step takes `period` [s].
        `speed_share` is the fraction of the speed limits that is used."""
        groups = groups_of(robot)
        movable = [servo.index for servo in robot.servos if is_movable(servo)]
        servos = [servo for servo in movable if groups[servo] == groups[movable[0]]]
        limits = [(servo.limits.lower, servo.limits.upper) for servo in robot.servos]
        self._box = np.array(limits, dtype=float).T.copy()
        middle = np.nan_to_num(self._box.mean(axis=0))
        self._group = None
        if servos:
            self._group = make_chain(
                robot, servos, middle, old=None, fresh=(), period=period, speed_share=speed_share,
                guard=lambda stop: None,
            )  # fmt: skip
        self._ends = [(middle + end)[servos] / 2.0 for end in self._box]
        self._speeds, self._sent = np.ones(len(servos)), np.empty(len(servos))

    def step(self) -> None:
        """Plans a motion to one of two targets, alternately, and takes one step. Does nothing if no servo has
        known limits."""
        if self._group is None:
            return
        self._ends.reverse()
        self._group.aim(self._group.index, self._ends[0], self._speeds, self._box, self._sent)
        self._group.limiter.step()
