"""Plays a gesture on a robot and measures the tracking error."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.arbiter import Arbiter
from tci.capabilities.capability import Capability
from tci.capabilities.play_gesture import GestureMemory, Phase, PlayGesture
from tci.capabilities.wrapper import CapabilityWrapper
from tci.drivers.driver import Driver
from tci.errors import CommandError
from tci.messages import Order, Perception
from tci.messages.frames import Array
from tci.reasons import Code
from tci.runtime.loop import Tick, run

MOST = 60.0
"""Longest time [s] for the approach and for interruptions, in addition to the duration of the gesture.
Without this limit, a touch that never ends would prevent the end of the playback. Assumed: usual
interruptions are shorter."""


@dataclass(frozen=True, slots=True)
class Following:
    """Tracking errors while a gesture was played. Errors during interruptions are not included."""

    phase: Phase
    """Phase of the playback at the end. The phase is DONE if the whole gesture was played."""
    duration: float
    """Time [s] between the first and the last step."""
    interruptions: int
    rms: dict[str, float]
    """Root mean square [rad] of the difference between gesture and measured angle, by `part.joint`."""
    largest: dict[str, float]
    """Largest difference [rad] between gesture and measured angle, by `part.joint`."""
    stopped: tuple[str, ...] = ()
    """Pairs of links, as `LINK near LINK`, because of which the gate stopped an arm. Each pair is listed only
    once."""

    def to_json(self) -> dict[str, Any]:
        """Returns the errors as JSON values."""
        return {
            "phase": self.phase.value, "duration_s": self.duration, "interruptions": self.interruptions,
            "rms_rad": self.rms, "largest_rad": self.largest, "stopped": list(self.stopped),
        }  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Memory of the gesture, and the errors measured so far."""

    inner: GestureMemory
    first: float | None
    count: int
    squares: Mapping[str, Array]
    largest: Mapping[str, Array]


@dataclass(frozen=True)
class _Followed(CapabilityWrapper[_Seen]):
    """Plays a gesture and measures in each step how far the joints are from it (the tracking error)."""

    inner: PlayGesture

    def inner_memory(self, memory: _Seen) -> GestureMemory:
        return memory.inner

    def with_inner_memory(self, memory: _Seen, inner: GestureMemory) -> _Seen:
        return replace(memory, inner=inner)

    def init(self, body: GenericBody) -> _Seen:
        zero = {part: np.zeros(angles.shape[1]) for part, angles in self.inner.gesture.postures.items()}
        return _Seen(self.inner.init(body), None, 0, zero, zero)

    def step(
        self, memory: _Seen, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], _Seen]:
        orders, after = super().step(memory, perception, body)
        if after.first is None:
            after = replace(after, first=perception.stamp)
        if after.inner.phase is not Phase.PLAY:
            return orders, after
        wanted = self.inner.gesture.at(after.inner.time)
        errors = {part: np.abs(angles - perception.posture[part]) for part, angles in wanted.items()}
        squares = {part: memory.squares[part] + error**2 for part, error in errors.items()}
        largest = {part: np.maximum(memory.largest[part], error) for part, error in errors.items()}
        return orders, replace(after, count=after.count + 1, squares=squares, largest=largest)


def follow(
    driver: Driver,
    play: PlayGesture,
    *,
    reflexes: Sequence[Capability[Any]] = (),
    observe: Callable[[Tick], None] | None = None,
) -> Following:
    """Plays a whole gesture on a robot and measures the tracking error.

    The capabilities `reflexes` may interrupt it. The function `observe` is called after each period. Raises
    the errors of `run`, and CommandError if the robot sends no valid reading.
    """
    stopped: dict[str, None] = {}

    def see(tick: Tick) -> None:
        for clamp in tick.sent.clamped:
            if clamp.code is Code.SELF_COLLISION:
                stopped[" near ".join(clamp.names)] = None
        if observe is not None:
            observe(tick)

    result = run(
        driver,
        Arbiter((*reflexes, _Followed(play))),
        duration=play.gesture.duration + MOST,
        observe=see,
        until=lambda memory: memory.layers[-1].memory.inner.phase is Phase.DONE,
    )
    memory: _Seen = result.memory.layers[-1].memory
    if memory.first is None:
        raise CommandError(
            f"{driver.robot.name} sent no valid reading, so the gesture was not played; look with: tci doctor"
        )
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
