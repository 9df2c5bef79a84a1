"""A contact stop around another behaviour: what is touched stops, and goes on when the touch is gone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Generic

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, Memory
from tci.capabilities.orders import begin_of, step_of
from tci.errors import CommandError, TciError
from tci.messages import (
    CONTROL_MODES,
    CartesianCommand,
    GenericCommand,
    Mode,
    Order,
    Perception,
    PlatformCommand,
)
from tci.reasons import Reason

Motion = GenericCommand | CartesianCommand


@dataclass(frozen=True, slots=True, eq=False)
class StopMemory(Generic[Memory]):
    """What goes on."""

    inner: Memory
    """The other behaviour's memory."""
    wanted: Mapping[str, Motion]
    """The last motion that it wanted of each part, by name."""
    touched: Mapping[str, float]
    """When each part that stands still was touched last [s], by name."""


@dataclass(frozen=True)
class ContactStop(Capability[StopMemory[Memory]], Generic[Memory]):
    """Runs `behaviour`, but a part that is touched stops where it is. Defaults are ours.

    The behaviour goes on meanwhile; what it wants of a part that stands still counts when the part is
    free again. Raises TciError for settings that make no sense.
    """

    behaviour: Capability[Memory]
    """What runs while nothing touches."""
    threshold: float = 1.0
    """Force [N] from which a contact stops its part."""
    quiet: float = 0.5
    """How long [s] a part must not be touched before it goes on."""

    def __post_init__(self) -> None:
        for name in ("threshold", "quiet"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"contact stop: {name} {getattr(self, name)}; valid: above 0, finite")

    def init(self, body: GenericBody) -> StopMemory[Memory]:
        return StopMemory(self.behaviour.init(body), {}, {})

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """What the behaviour begins with."""
        return begin_of(self.behaviour, perception, body)

    def step(
        self, memory: StopMemory[Memory], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], StopMemory[Memory]]:
        """The behaviour's commands, but for parts that stand still; raises what it raises.

        Raises CommandError for a command in the robot's own joints: which part it moves is not known here.
        """
        now = perception.stamp
        touched = {part: since for part, since in memory.touched.items() if now - since < self.quiet}
        for contact in perception.contacts:
            if contact.force >= self.threshold:
                touched[contact.part] = now
        inner, memory_after = step_of(self.behaviour, memory.inner, perception, body)
        wanted = dict(memory.wanted)
        commands: list[Order] = []
        fresh = set()
        for command in inner:
            if isinstance(command, PlatformCommand):
                raise CommandError("the contact stop moves generic parts only; valid: commands to those")
            if isinstance(command, CartesianCommand) or (
                isinstance(command, GenericCommand) and command.mode in CONTROL_MODES
            ):
                wanted[command.part] = command
                fresh.add(command.part)
                if command.part in touched:
                    continue
            commands.append(command)
        for part, command in wanted.items():
            if part in touched and part not in memory.touched:
                commands.append(_hold(command, perception))
            elif part in memory.touched and part not in touched and part not in fresh:
                commands.append(command)
        return tuple(commands), StopMemory(memory_after, wanted, touched)

    def notes(self, memory: StopMemory[Memory]) -> tuple[str, ...]:
        """The behaviour's."""
        return self.behaviour.notes(memory.inner)

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """The behaviour's."""
        return self.behaviour.fault(perception, body)


def _hold(command: Motion, perception: Perception) -> GenericCommand:
    """Instead of a motion: stay where the part is; no velocity, no torque."""
    if isinstance(command, CartesianCommand):
        return GenericCommand(command.part, Mode.POSITION, perception.posture[command.part])
    if command.mode in (Mode.POSITION, Mode.IMPEDANCE):
        return GenericCommand(command.part, command.mode, perception.posture[command.part])
    return GenericCommand(command.part, command.mode, np.zeros(command.values.size))
