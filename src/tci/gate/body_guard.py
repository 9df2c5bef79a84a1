"""Checks planned stops for self-collision before groups of servos take their next step."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tci.gate.joint_group import JointGroup
from tci.gate.kernels.stops import take_room
from tci.gate.self_collision import SelfCollision
from tci.gate.stop_plan import StopTrajectory
from tci.messages.frames import Array
from tci.reasons import Reason

LOOKS = 16
"""Number of points of a planned stop at which the robot is checked for self-collision, including both ends.
Assumed: the number is sufficient, because `SelfCollision` also checks the path between two points."""
SHARES = np.linspace(0.0, 1.0, LOOKS)


class BodyGuard:
    """Checks the stops of all joint groups together. A state is sent to the robot only if the stop from this
    state causes no self-collision.

    Joints lag behind their references and sag under their weight. So each path is checked twice: once as
    planned, and once with all angles shifted by the present difference between measured angles and
    references.
    """

    def __init__(self, body: SelfCollision, *, period: float) -> None:
        """Stores `body`, which checks postures for self-collision, and `period` [s], the time of one step."""
        self._body = body
        self._period = period
        self._box = np.zeros((2, 0))
        self._before: dict[JointGroup, Array] = {}
        self._waiting: set[JointGroup] = set()

    def turns(self, moving: Collection[JointGroup]) -> Iterator[JointGroup]:
        """Yields the `moving` groups one after the other. The caller must move each group by one period
        before the caller requests the next group."""
        self._waiting = {*moving}
        self._before.clear()
        for chain in moving:
            before = chain.limiter.position
            yield chain
            self._waiting.discard(chain)
            self._before[chain] = before
        self._before.clear()

    def fault(
        self, index: NDArray[np.intp], stop: StopTrajectory, others: Sequence[JointGroup], measured: Array
    ) -> Reason | None:
        """Returns the reason why the servos `index` (n,) must not take their next step; None if they may. The
        step ends where the planned stop `stop` begins. The groups `others` stop at the same time.

        Servos that belong to no group are assumed to stay at their `measured` (n_servos,) [rad] angles.
        """
        if (box := self._box).shape[1] != len(measured):
            box = self._box = np.empty((2, len(measured)))
        box[:] = measured
        take_room(index, measured, stop.here, stop.span, box)
        for other in others:
            limiter = other.limiter
            take_room(other.index, measured, self._before.get(other, limiter.position), limiter.span, box)
        if self._body.keeps_margin(box):
            return None
        return self._fault_of_path(index, stop, others, measured)

    def fault_of_way(
        self, index: NDArray[np.intp], ways: Array, others: Sequence[JointGroup], measured: Array
    ) -> Reason | None:
        """The reason why servos `index` (k,) in torque mode must not go on by `ways` (k,) [rad] from where
        they were measured, while the groups `others` stop; None if they may."""
        box = np.array([measured, measured])
        box[0, index] += np.minimum(ways, 0.0)
        box[1, index] += np.maximum(ways, 0.0)
        for other in others:
            take_room(other.index, measured, other.limiter.position, other.limiter.span, box)
        if self._body.keeps_margin(box):
            return None
        path = measured[None].repeat(LOOKS, axis=0)
        path[:, index] += SHARES[:, None] * ways
        for other in others:
            limiter = other.limiter
            stop = limiter.stop_at(limiter.remaining * SHARES)
            path[:, other.index] += stop - stop[0]
        return self._body.fault(path)

    def _fault_of_path(
        self, index: NDArray[np.intp], stop: StopTrajectory, others: Sequence[JointGroup], measured: Array
    ) -> Reason | None:
        """Returns a reason if the servos `index` must not take their next step, because their planned `stop`,
        together with the stops of the groups `others`, would cause a self-collision; otherwise None."""
        reference, deviation = np.array(measured), np.zeros(len(measured))
        reference[index] = stop.here
        deviation[index] = measured[index] - stop.here
        for other in others:
            here = reference[other.index] = other.limiter.position
            deviation[other.index] = measured[other.index] - self._before.get(other, here)
        duration = stop.duration
        longest = max((other.limiter.remaining for other in others), default=0.0)
        times = duration * SHARES
        if longest > duration:  # another group may still move when this group rests
            times = np.concatenate([times, duration + (longest - duration) * SHARES[1:]])
        path = reference[None].repeat(1 + len(times), axis=0)
        path[1:, index] = stop.states(times)[:, 0]
        for other in others:
            lead = self._period if other in self._waiting else 0.0
            path[1:, other.index] = other.limiter.stop_at(times + lead)
        return self._body.fault(path) or self._body.fault(path + deviation)
