"""Playback of a gesture (the paper's second example of a capability), which a reflex may interrupt.

While the reflex moves a part, the gesture is paused. Then all parts return to the posture at which the
gesture was paused, and the gesture continues from this posture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.orders import begin_of, step_of
from tci.errors import TciError
from tci.gestures.gesture import Fitted, Gesture
from tci.messages import GenericCommand, Mode, Order, Perception
from tci.messages.frames import read_only
from tci.reasons import Reason


class Phase(Enum):
    """Phase of a playback."""

    APPROACH = "approach"
    """The parts move to the posture at which the gesture begins or continues."""
    PLAY = "play"
    INTERRUPTED = "interrupted"
    """The reflex moves a part of the gesture, so the gesture commands no motion."""
    DONE = "done"


@dataclass(frozen=True, slots=True, eq=False)
class GestureMemory:
    """Memory of a playback."""

    phase: Phase
    time: float
    """Time [s] since the beginning of the gesture, without pauses."""
    since: float | None
    """Time [s] at which the phase began. The value is None before the first step."""
    stamp: float
    """Time of the latest step [s]."""
    reflex: Any
    """Memory of the reflex that may interrupt the gesture; None if there is no reflex."""
    interruptions: int
    """Number of interruptions by the reflex."""


@dataclass(frozen=True)
class PlayGesture(Capability[GestureMemory]):
    """Plays a gesture that was fitted to the robot. Raises TciError for a setting out of range."""

    fitted: Fitted
    """The gesture, fitted to the robot (`tci.gestures.gesture.fit`)."""
    reflex: Capability[Any] | None = None
    """Reflex that may interrupt the gesture. Its memory must be iterable, and yield the names of the parts
    that the reflex currently moves."""
    near: float = float(np.deg2rad(1.0))
    """The gesture begins or continues when each joint is within this distance [rad] of its target. Assumed:
    this distance is not visible."""
    patience: float = 3.0
    """Longest time [s] of the motion to the posture at which the gesture begins or continues. After this time
    the gesture starts even if the posture is not reached. Assumed: an obstacle may prevent a part from
    reaching this posture."""
    ease: float = 0.4
    """Time [s] in which the gesture accelerates to its full speed. Assumed: a faster start looks jerky."""

    def __post_init__(self) -> None:
        for name in ("near", "patience", "ease"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"gesture: {name} {getattr(self, name)}; valid: above 0, finite")

    @property
    def gesture(self) -> Gesture:
        """The motion that the robot should follow, in the robot's generic joints."""
        return self.fitted.gesture

    def init(self, body: GenericBody) -> GestureMemory:
        inner = None if self.reflex is None else self.reflex.init(body)
        return GestureMemory(Phase.APPROACH, 0.0, None, 0.0, inner, 0)

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """Returns the first orders of `reflex`, or no orders if there is no reflex."""
        return () if self.reflex is None else begin_of(self.reflex, perception, body)

    def step(
        self, memory: GestureMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], GestureMemory]:
        """Returns the commands of the gesture and of the reflex. While the reflex moves a part of the
        gesture, the gesture commands no motion."""
        now = perception.stamp
        inner, orders, busy = memory.reflex, tuple[Order, ...](), frozenset[str]()
        if self.reflex is not None:
            orders, inner = step_of(self.reflex, memory.reflex, perception, body)
            busy = frozenset(inner)
        fresh = memory.since is None
        elapsed = 0.0 if fresh else now - memory.stamp
        memory = replace(memory, reflex=inner, stamp=now, since=now if fresh else memory.since)
        if memory.phase is Phase.DONE:
            return orders, memory
        if busy & self.gesture.postures.keys():
            if memory.phase is not Phase.INTERRUPTED:
                count = memory.interruptions + 1
                memory = replace(memory, phase=Phase.INTERRUPTED, since=now, interruptions=count)
                return orders + self._hold(perception, busy), memory
            return orders, memory
        if fresh or memory.phase is Phase.INTERRUPTED:
            return orders + _go(self.gesture, memory.time), replace(memory, phase=Phase.APPROACH, since=now)
        if memory.phase is Phase.APPROACH:
            assert memory.since is not None
            if not self._is_near(memory.time, perception) and now - memory.since < self.patience:
                return orders, memory
            return orders, replace(memory, phase=Phase.PLAY, since=now)
        assert memory.since is not None
        pace = min(1.0, (now - memory.since) / self.ease)
        time = min(memory.time + pace * elapsed, self.gesture.duration)
        done = time >= self.gesture.duration
        memory = replace(memory, time=time, phase=Phase.DONE if done else Phase.PLAY)
        return orders + self._lead(time, 0.0 if done else pace), memory

    def notes(self, memory: GestureMemory) -> tuple[str, ...]:
        """Returns the reflex's notes for a person."""
        return () if self.reflex is None else self.reflex.notes(memory.reflex)

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns the reflex's reason to stop the robot, or None. Without a reflex the result is None,
        because a gesture needs no skin."""
        return None if self.reflex is None else self.reflex.fault(perception, body)

    def _lead(self, time: float, pace: float) -> tuple[Order, ...]:
        """Returns commands with which the parts follow the gesture at `time` [s].

        The gate (the safety filter before the driver) plans a stop at every target. So the targets lie ahead
        of the gesture, by the fraction `pace` of the distance that a part needs to stop.
        """
        here, ahead = self.gesture.at(time), self.fitted.targets.at(time)
        return tuple(
            GenericCommand(part, Mode.POSITION, read_only(angles + pace * (ahead[part] - angles)))
            for part, angles in here.items()
        )

    def _hold(self, perception: Perception, busy: frozenset[str]) -> tuple[Order, ...]:
        """Returns commands that keep each part of the gesture at its present posture. The parts `busy`, which
        the reflex moves, get no command."""
        return tuple(
            GenericCommand(part, Mode.POSITION, perception.posture[part])
            for part in self.gesture.postures
            if part not in busy
        )

    def _is_near(self, time: float, perception: Perception) -> bool:
        wanted = self.gesture.at(time)
        return all(
            np.abs(angles - perception.posture[part]).max() <= self.near for part, angles in wanted.items()
        )


def _go(gesture: Gesture, time: float) -> tuple[Order, ...]:
    return tuple(GenericCommand(part, Mode.POSITION, angles) for part, angles in gesture.at(time).items())
