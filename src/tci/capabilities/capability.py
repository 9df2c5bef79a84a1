"""The base class of capabilities: frozen settings, explicit memory (Fig. 2, L4)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

from tci.body.generic_body import GenericBody
from tci.messages import Order, Perception
from tci.reasons import Reason

Memory = TypeVar("Memory")


class Capability(ABC, Generic[Memory]):
    """A behaviour on the generic body. It does not depend on a robot, a clock or a middleware.

    Settings are frozen in the object. All that changes is in the memory, which the caller passes in and gets
    back. Equal memory and perception give equal commands, bit for bit, so that recordings can be replayed.
    """

    @abstractmethod
    def init(self, body: GenericBody) -> Memory:
        """Returns the memory before the first step."""

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """Returns the orders to execute once before the first step, such as control modes. None by default.

        If the robot refuses one of them, the capability is not run.
        """
        return ()

    @abstractmethod
    def step(
        self, memory: Memory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        """Returns the commands for this instant and the memory for the next one. Changes no argument.

        A command is needed only when the target changes: the gate keeps moving towards the last one.

        Contacts may be on any part of the robot, also on one that this behaviour does not move, such as the
        switches on NAO's head. Ignore those: use only contacts whose `part` is among the parts that you move,
        and look up other parts with `.get`.
        """

    def notes(self, memory: Memory) -> tuple[str, ...]:
        """Returns messages for a person, such as the reason why a touched part does not move."""
        return ()

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Returns the reason why the robot must stop, such as blind skin that this behaviour depends on; None
        if there is none."""
        return None
