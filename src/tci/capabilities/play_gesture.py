"""Reproduces a gesture (the paper's second example of a capability), and lets a reflex interrupt it.

While a reflex moves a part the gesture's time stands still. When it is over, the parts go back to where
the gesture stopped, and it goes on from there.
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
from tci.frames import read_only
from tci.gestures.gesture import Fitted, Gesture
from tci.messages import GenericCommand, Mode, Order, Perception
from tci.reasons import Reason


class Phase(Enum):
    """What is going on."""

    APPROACH = "approach"
    """The parts go to where the gesture begins, or goes on."""
    PLAY = "play"
    INTERRUPTED = "interrupted"
    """The reflex moves a part."""
    DONE = "done"


@dataclass(frozen=True, slots=True, eq=False)
class GestureMemory:
    """What goes on."""

    phase: Phase
    time: float
    """How far the gesture is [s]."""
    since: float | None
    """When the phase began [s]; None before the first step."""
    stamp: float
    """Time of the latest step [s]."""
    reflex: Any
    """The reflex' memory."""
    interruptions: int
    """Times that the reflex took over."""


@dataclass(frozen=True)
class PlayGesture(Capability[GestureMemory]):
    """Plays a gesture that was fitted to the robot. Defaults are ours. Raises TciError for settings."""

    fitted: Fitted
    """The gesture, fitted to the robot (`tci.gestures.gesture.fit`)."""
    reflex: Capability[Any] | None = None
    """Moves parts away from what touches them: its memory names the parts that it moves now."""
    near: float = float(np.deg2rad(1.0))
    """Distance [rad] of every joint at which the gesture begins, or goes on."""
    patience: float = 3.0
    """Longest time [s] to wait for that: something may be in the way."""
    ease: float = 0.4
    """Time [s] in which the gesture's clock gets up to speed."""

    def __post_init__(self) -> None:
        for name in ("near", "patience", "ease"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"gesture: {name} {getattr(self, name)}; valid: above 0, finite")

    @property
    def gesture(self) -> Gesture:
        """Where the robot should be, in its own generic joints."""
        return self.fitted.gesture

    def init(self, body: GenericBody) -> GestureMemory:
        inner = None if self.reflex is None else self.reflex.init(body)
        return GestureMemory(Phase.APPROACH, 0.0, None, 0.0, inner, 0)

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """What the reflex begins with."""
        return () if self.reflex is None else begin_of(self.reflex, perception, body)

    def step(
        self, memory: GestureMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], GestureMemory]:
        """Commands of gesture or reflex; never both for one part."""
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
        """The reflex's."""
        return () if self.reflex is None else self.reflex.notes(memory.reflex)

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """The reflex's: a gesture needs no skin."""
        return None if self.reflex is None else self.reflex.fault(perception, body)

    def _lead(self, time: float, pace: float) -> tuple[Order, ...]:
        """To where the robot should be, and ahead by the share `pace` of what a stop takes."""
        here, ahead = self.gesture.at(time), self.fitted.targets.at(time)
        return tuple(
            GenericCommand(part, Mode.POSITION, read_only(angles + pace * (ahead[part] - angles)))
            for part, angles in here.items()
        )

    def _hold(self, perception: Perception, busy: frozenset[str]) -> tuple[Order, ...]:
        """The gesture's other parts stay where they are."""
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
