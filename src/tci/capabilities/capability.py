"""The base class of capabilities: frozen settings, explicit memory (Fig. 2, L4)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from inspect import isfunction, signature
from typing import Any, Generic, TypeVar

from tci.body.generic_body import GenericBody
from tci.errors import TciError
from tci.messages import Order, Perception
from tci.reasons import Reason

Memory = TypeVar("Memory")


class Capability(ABC, Generic[Memory]):
    """A behaviour on the generic body. It does not depend on a robot, a clock or a middleware.

    Settings are frozen in the object. All that changes is in the memory, which the caller passes in and gets
    back. Equal memory and perception give equal commands, bit for bit, so that recordings can be replayed.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        """Raises TciError if a method of the subclass can't be called with the arguments declared below."""
        super().__init_subclass__(**options)
        for name in ("init", "begin", "step", "notes", "fault"):
            own, declared = vars(cls).get(name), signature(getattr(Capability, name)).parameters
            if not isfunction(own):
                continue
            try:
                signature(own).bind(*declared)
            except TypeError:
                raise TciError(
                    f"{cls.__name__}.{name}({', '.join(signature(own).parameters)}) has other arguments than "
                    f"a capability; valid: def {name}({', '.join(declared)})"
                ) from None

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
