"""How closely a robot follows a gesture."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.play_gesture import GestureMemory, Phase, PlayGesture
from tci.drivers.driver import Driver
from tci.errors import CommandError
from tci.frames import Array
from tci.messages import Order, Perception
from tci.reasons import Reason
from tci.runtime.loop import Tick, run

MOST = 60.0
"""Time [s] beside the gesture's own that approaching it and interruptions may take. Ours."""

NEAR = re.compile(r"stopped on the way: (\S+) would come .* near ([^\s;]+)")
"""What the gate says when the robot's own body is in the way."""


@dataclass(frozen=True, slots=True)
class Following:
    """What was seen while a gesture was played; interruptions do not count as errors."""

    phase: Phase
    """How it ended."""
    duration: float
    """From first step to last [s]."""
    interruptions: int
    rms: dict[str, float]
    """Root mean square error [rad] of every joint by `part.joint`, against where it should have been then."""
    largest: dict[str, float]
    """Largest error [rad] of every joint."""
    stopped: tuple[str, ...] = ()
    """Pairs of links, `one near other`, before which the gate stopped an arm on its way, each once."""

    def to_json(self) -> dict[str, Any]:
        """As a dictionary of plain values."""
        return {
            "phase": self.phase.value, "duration_s": self.duration, "interruptions": self.interruptions,
            "rms_rad": self.rms, "largest_rad": self.largest, "stopped": list(self.stopped),
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The gesture's memory, and its errors until now."""

    inner: GestureMemory
    first: float | None
    count: int
    squares: Mapping[str, Array]
    largest: Mapping[str, Array]


@dataclass(frozen=True)
class _Followed(Capability[_Seen]):
    """A gesture that is played, and watched."""

    play: PlayGesture

    def init(self, body: GenericBody) -> _Seen:
        zero = {part: np.zeros(angles.shape[1]) for part, angles in self.play.gesture.postures.items()}
        return _Seen(self.play.init(body), None, 0, zero, zero)

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """What the gesture begins with."""
        return self.play.begin(perception, body)

    def step(
        self, memory: _Seen, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], _Seen]:
        """The gesture's."""
        orders, inner = self.play.step(memory.inner, perception, body)
        first = perception.stamp if memory.first is None else memory.first
        if inner.phase is not Phase.PLAY:
            return orders, _Seen(inner, first, memory.count, memory.squares, memory.largest)
        wanted = self.play.gesture.at(inner.time)
        errors = {part: np.abs(angles - perception.posture[part]) for part, angles in wanted.items()}
        squares = {part: memory.squares[part] + error**2 for part, error in errors.items()}
        largest = {part: np.maximum(memory.largest[part], error) for part, error in errors.items()}
        return orders, _Seen(inner, first, memory.count + 1, squares, largest)

    def notes(self, memory: _Seen) -> tuple[str, ...]:
        """The gesture's."""
        return self.play.notes(memory.inner)

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """The gesture's."""
        return self.play.fault(perception, body)


def follow(driver: Driver, play: PlayGesture, *, observe: Callable[[Tick], None] | None = None) -> Following:
    """Play a gesture to its end on a robot; `observe` is called after each period.

    Raises what `run` raises, and CommandError when the robot sends nothing.
    """
    stopped: dict[str, None] = {}

    def see(tick: Tick) -> None:
        for said in tick.sent.clamped:
            if met := NEAR.search(said):
                stopped[f"{met[1]} near {met[2]}"] = None
        if observe is not None:
            observe(tick)

    result = run(
        driver,
        _Followed(play),
        duration=play.gesture.duration + MOST,
        observe=see,
        until=lambda memory: memory.inner.phase is Phase.DONE,
    )
    memory = result.memory
    if memory.first is None:
        raise CommandError(f"{driver.robot.name} sent nothing that fits it; nothing was played")
    robot = driver.robot
    names = {part: [joint.name for joint in robot.part(part).servos] for part in play.gesture.postures}
    count = max(memory.count, 1)
    rms = {part: np.sqrt(squares / count) for part, squares in memory.squares.items()}
    return Following(
        phase=memory.inner.phase,
        duration=memory.inner.stamp - memory.first,
        interruptions=memory.inner.interruptions,
        rms=_named(names, rms),
        largest=_named(names, memory.largest),
        stopped=tuple(stopped),
    )


def _named(names: Mapping[str, list[str]], values: Mapping[str, Array]) -> dict[str, float]:
    return {
        f"{part}.{joint}": float(value)
        for part, joints in names.items()
        for joint, value in zip(joints, values[part], strict=True)
    }
