"""A capability that runs another one and changes something about it."""

from __future__ import annotations

from typing import Any, Generic, cast

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, Memory
from tci.capabilities.needs import Need
from tci.capabilities.orders import begin_of, pause_of, resume_of, step_of
from tci.messages import Order, Perception
from tci.reasons import Reason


class CapabilityWrapper(Capability[Memory], Generic[Memory]):
    """Forwards every method to the capability `inner`; a subclass overrides what it changes.

    By default its memory is the memory of `inner`. A subclass with a memory of its own overrides `init`,
    `inner_memory` and `with_inner_memory`, and may call `super().step(...)`.
    """

    inner: Capability[Any]
    """The capability that it runs."""

    def __init__(self, inner: Capability[Any]) -> None:
        self.inner = inner

    @property
    def needs(self) -> tuple[Need, ...]:
        return self.inner.needs

    def inner_memory(self, memory: Memory) -> Any:
        """The memory of `inner` within `memory`."""
        return memory

    def with_inner_memory(self, memory: Memory, inner: Any) -> Memory:
        """`memory` with another memory of `inner`."""
        return cast(Memory, inner)

    def init(self, body: GenericBody) -> Memory:
        return cast(Memory, self.inner.init(body))

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return begin_of(self.inner, perception, body)

    def step(
        self, memory: Memory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        orders, inner = step_of(self.inner, self.inner_memory(memory), perception, body)
        return orders, self.with_inner_memory(memory, inner)

    def claims(self, memory: Memory) -> frozenset[str]:
        return self.inner.claims(self.inner_memory(memory))

    def pause(
        self, memory: Memory, taken: frozenset[str], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Memory]:
        orders, inner = pause_of(self.inner, self.inner_memory(memory), taken, perception, body)
        return orders, self.with_inner_memory(memory, inner)

    def resume(
        self,
        memory: Memory,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], Memory]:
        orders, inner = resume_of(self.inner, self.inner_memory(memory), taken, last, perception, body)
        return orders, self.with_inner_memory(memory, inner)

    def notes(self, memory: Memory) -> tuple[str, ...]:
        return self.inner.notes(self.inner_memory(memory))

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        return self.inner.fault(perception, body)


def unwrapped(capability: Capability[Any]) -> Capability[Any]:
    """What wrappers of wrappers run in the end; a capability that is no wrapper is returned itself."""
    while isinstance(capability, CapabilityWrapper):
        capability = capability.inner
    return capability
