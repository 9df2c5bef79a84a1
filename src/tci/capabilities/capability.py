"""What every capability has in common: frozen settings, explicit memory (Fig. 2, L4)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from tci.body.generic_body import GenericBody
from tci.messages import Order, Perception
from tci.reasons import Reason

Memory = TypeVar("Memory")


class Capability(ABC, Generic[Memory]):
    """A behaviour on the generic body. It knows no robot, no clock and no wire.

    Settings are frozen in the object, and all that changes is in the memory that the caller hands
    in and gets back. The same memory and perception give the same commands, bit for bit, so a
    recording can be replayed through it.
    """

    @abstractmethod
    def init(self, body: GenericBody) -> Memory:
        """The memory to start with."""

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """What it asks for once, before its first step: control modes, stiffness. Nothing, mostly.

        Where the robot refuses any of it, the capability is not run.
        """
        return ()

    @abstractmethod
    def step(
        self, memory: Memory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        """Commands for this instant, and the memory for the next one.

        Commands are given when they change: the gate goes on towards the last one. Neither argument
        is changed.

        A contact may be on any part of any robot, also on one that this behaviour does not know, such as the
        switches on NAO's head. Pass over it: keep the contacts whose `part` is among the parts that you move,
        and look others up with `.get`.
        """

    def notes(self, memory: Memory) -> tuple[str, ...]:
        """What a person should know of what it did, or why it did nothing; mostly nothing."""
        return ()

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns why the robot must stop: something that this behaviour needs is gone. None while all is
        well."""
        return None
