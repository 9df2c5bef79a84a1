"""A behaviour that runs another behaviour and stops its parts while they, or one part for all, are
touched."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, Memory
from tci.capabilities.needs import Need
from tci.capabilities.orders import moved_part
from tci.capabilities.sway import Sway
from tci.capabilities.wrapper import CapabilityWrapper
from tci.errors import CommandError, TciError
from tci.messages import CartesianCommand, Contact, GenericCommand, Mode, Order, Perception, PlatformCommand

Motion = GenericCommand | CartesianCommand


@dataclass(frozen=True, slots=True, eq=False)
class StopMemory(Generic[Memory]):
    """Memory of a contact stop."""

    inner: Memory
    """Memory of the behaviour that ContactStop runs and stops."""
    wanted: Mapping[str, Motion]
    """Maps each part to the last motion that the behaviour commanded."""
    touched: Mapping[str, float]
    """Maps each stopped part to the time [s] of its latest touch."""


@dataclass(frozen=True)
class ContactStop(CapabilityWrapper[StopMemory[Memory]], Generic[Memory]):
    """Runs another behaviour, but stops each touched part until the touch ends, or all parts while the part
    `by` is touched.

    During a stop, `step` of the behaviour is still called, but commands to the stopped part are not executed.
    After the touch, the behaviour's last command to this part is executed. Raises TciError for a setting out
    of range.
    """

    inner: Capability[Memory]
    """Behaviour to run."""
    threshold: float = 0.8
    """Smallest force [N] of a contact that stops. Assumed: a light push of a finger; a pressed switch of a
    NAO counts as 1 N."""
    quiet: float = 0.5
    """Time [s] without touch after which a stopped part continues. Assumed: a hand that slides or shakes
    makes contact again within this time."""
    by: str = ""
    """Kind or name of the part whose touch stops all parts, such as "head". Empty: the touch of a part stops
    this part."""

    def __post_init__(self) -> None:
        for name in ("threshold", "quiet"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"contact stop: {name} {getattr(self, name)}; valid: above 0, finite")

    @property
    def needs(self) -> tuple[Need, ...]:
        own = Need(f"skin on a {self.by}", (self.by,)) if self.by else Need("skin on any part")
        return (*super().needs, own)

    def inner_memory(self, memory: StopMemory[Memory]) -> Memory:
        return memory.inner

    def with_inner_memory(self, memory: StopMemory[Memory], inner: Memory) -> StopMemory[Memory]:
        return replace(memory, inner=inner)

    def init(self, body: GenericBody) -> StopMemory[Memory]:
        return StopMemory(self.inner.init(body), {}, {})

    def step(
        self, memory: StopMemory[Memory], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], StopMemory[Memory]]:
        """Returns the behaviour's commands to parts that are not stopped, and the orders that stop or
        continue parts.

        Raises the errors of the behaviour, and CommandError if the behaviour commands the robot's own joints,
        because the generic part of such a command is unknown.
        """
        now = perception.stamp
        touched = {part: since for part, since in memory.touched.items() if now - since < self.quiet}
        for contact in perception.contacts:
            if contact.force >= self.threshold:
                touched |= dict.fromkeys(self._stopped_by(contact, perception, body), now)
        given, after = super().step(memory, perception, body)
        wanted = dict(memory.wanted)
        commands: list[Order] = []
        fresh = set()
        for command in given:
            if isinstance(command, PlatformCommand):
                raise CommandError(
                    "contact stop: a command in the robot's own joints; valid: commands to generic parts"
                )
            if isinstance(command, Motion) and moved_part(command):
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
        return tuple(commands), replace(after, wanted=wanted, touched=touched)

    def _stopped_by(self, contact: Contact, perception: Perception, body: GenericBody) -> Iterable[str]:
        if not self.by:
            return (contact.part,)
        is_by = self.by in (contact.part, body.robot.part(contact.part).kind)
        return perception.posture if is_by else ()

    def resume(
        self,
        memory: StopMemory[Memory],
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], StopMemory[Memory]]:
        """A part that is still touched stays where it is."""
        orders, after = super().resume(memory, taken, last, perception, body)
        return tuple(order for order in orders if moved_part(order) not in memory.touched), after


HEAD_STOP = ContactStop(Sway(), by="head")
"""Both arms sway until somebody touches the head: `tci run head-stop nao-plain`."""


def _hold(command: Motion, perception: Perception) -> GenericCommand:
    """Returns the command that stops a part in the control mode of `command`.

    The values of this command are the present posture, zero velocity or zero torque.
    """
    if isinstance(command, CartesianCommand):
        return GenericCommand(command.part, Mode.POSITION, perception.posture[command.part])
    if command.mode in (Mode.POSITION, Mode.IMPEDANCE):
        return GenericCommand(command.part, command.mode, perception.posture[command.part])
    return GenericCommand(command.part, command.mode, np.zeros(command.values.size))
