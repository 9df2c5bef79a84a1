"""Playback of a gesture (the paper's second example of a capability).

If a layer above takes one of its parts, the gesture pauses. Afterwards all parts return to the posture at
which it paused, and it goes on from there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.errors import TciError
from tci.gestures.gesture import Fitted, Gesture
from tci.messages import GenericCommand, Mode, Order, Perception
from tci.messages.frames import read_only


class Phase(Enum):
    """Phase of a playback."""

    APPROACH = "approach"
    """The parts move to the posture at which the gesture begins or continues."""
    PLAY = "play"
    INTERRUPTED = "interrupted"
    """A layer above has a part of the gesture, so the gesture commands no motion."""
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
    interruptions: int
    """Number of interruptions."""


@dataclass(frozen=True)
class PlayGesture(Capability[GestureMemory]):
    """Plays a gesture that was fitted to the robot. Raises TciError for a setting out of range."""

    fitted: Fitted
    """The gesture, fitted to the robot (`tci.gestures.gesture.fit`)."""
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
        return GestureMemory(Phase.APPROACH, 0.0, None, 0.0, 0)

    def step(
        self, memory: GestureMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], GestureMemory]:
        now = perception.stamp
        fresh = memory.since is None
        elapsed = 0.0 if fresh else now - memory.stamp
        memory = replace(memory, stamp=now, since=now if fresh else memory.since)
        if fresh:
            return self._go(memory.time), memory
        if memory.phase in (Phase.DONE, Phase.INTERRUPTED) or now == memory.since:
            return (), memory
        if memory.phase is Phase.APPROACH:
            assert memory.since is not None
            if not self._is_near(memory.time, perception) and now - memory.since < self.patience:
                return (), memory
            return (), replace(memory, phase=Phase.PLAY, since=now)
        assert memory.since is not None
        pace = min(1.0, (now - memory.since) / self.ease)
        time = min(memory.time + pace * elapsed, self.gesture.duration)
        done = time >= self.gesture.duration
        memory = replace(memory, time=time, phase=Phase.DONE if done else Phase.PLAY)
        return self._lead(time, 0.0 if done else pace), memory

    def claims(self, memory: GestureMemory) -> frozenset[str]:
        """The gesture's parts, until it is done."""
        return frozenset(() if memory.phase is Phase.DONE else self.gesture.postures)

    def pause(
        self, memory: GestureMemory, taken: frozenset[str], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], GestureMemory]:
        """Keeps the other parts of the gesture where they are."""
        if memory.phase in (Phase.DONE, Phase.INTERRUPTED) or taken.isdisjoint(self.gesture.postures):
            return (), memory
        hold = tuple(
            GenericCommand(part, Mode.POSITION, perception.posture[part])
            for part in self.gesture.postures
            if part not in taken
        )
        count = memory.interruptions + 1
        return hold, replace(memory, phase=Phase.INTERRUPTED, since=perception.stamp, interruptions=count)

    def resume(
        self,
        memory: GestureMemory,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], GestureMemory]:
        """Returns to the posture at which it paused, once all parts are back."""
        if memory.phase is not Phase.INTERRUPTED or not taken.isdisjoint(self.gesture.postures):
            return (), memory
        return self._go(memory.time), replace(memory, phase=Phase.APPROACH, since=perception.stamp)

    def _go(self, time: float) -> tuple[Order, ...]:
        return tuple(
            GenericCommand(part, Mode.POSITION, angles) for part, angles in self.gesture.at(time).items()
        )

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

    def _is_near(self, time: float, perception: Perception) -> bool:
        wanted = self.gesture.at(time)
        return all(
            np.abs(angles - perception.posture[part]).max() <= self.near for part, angles in wanted.items()
        )
