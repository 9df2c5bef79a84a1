"""The loop: read, perceive, decide, gate, write; once per period of the link."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from tci.capabilities.capability import Capability
from tci.errors import CommandError
from tci.interface.body import Body
from tci.interface.gate import SafeCommand
from tci.messages import Command, Perception, Reading
from tci.middleware.link import Link

Memory = TypeVar("Memory")


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """All that passed through the loop in one period."""

    now: float
    """Time [s] on the link's clock."""
    reading: Reading
    """What the robot sent."""
    perception: Perception
    """What the capability saw."""
    commands: tuple[Command, ...]
    """What the capability wanted."""
    sent: SafeCommand
    """What the gate let pass and the link sent."""


def run(
    link: Link,
    capability: Capability[Memory],
    *,
    duration: float | None = None,
    observe: Callable[[Tick], None] | None = None,
) -> Memory:
    """Run a capability on a robot for `duration` [s], or until interrupted, and return its memory.

    `observe` is called after each tick; the loop waits for it. Raises CommandError, before anything
    moves, when the robot refuses what the capability begins with; and what link and capability raise.
    """
    body = Body(link.robot)
    memory = capability.init()
    begun = False
    for now in link.ticks(duration=duration):
        reading = link.read()
        perception = body.perceive(reading, now)
        opening = () if begun else capability.begin(perception)
        if opening:
            commands = opening
        else:
            commands, memory = capability.step(memory, perception)
        sent = link.write(link.gate.step(body.to_platform(commands, reading.joints), reading.joints, now))
        if opening and sent.refusals:
            raise CommandError(f"{type(capability).__name__} can't begin: {'; '.join(sent.refusals)}")
        begun = True
        if observe is not None:
            observe(Tick(now, reading, perception, commands, sent))
    return memory
