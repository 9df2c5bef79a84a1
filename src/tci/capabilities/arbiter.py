"""Several capabilities at once, the more urgent one first: a reflex above a task above a gesture.

Every layer steps in every period and feels every contact. What a layer claims, the layers below can't move;
they go on where they left it when it comes back. If layers move a part in different control modes, the part
changes its mode with its owner.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.layer import Layer, check_modes, step_layer, with_modes
from tci.capabilities.needs import Need
from tci.capabilities.orders import begin_of, named
from tci.capabilities.wrapper import CapabilityWrapper, unwrapped
from tci.errors import CommandError, TciError
from tci.messages import Command, Order, Perception
from tci.reasons import Reason


@dataclass(frozen=True, slots=True, eq=False)
class ArbiterMemory:
    """Memory of an `Arbiter`."""

    layers: tuple[Layer, ...]
    """One for each layer, the highest first."""
    taken: frozenset[str] = frozenset()
    """Parts that layers above the arbiter itself claim, if it is a layer of another one."""


@dataclass(frozen=True)
class Arbiter(Capability[ArbiterMemory]):
    """Runs several capabilities, of which the first has the highest priority.

    A part belongs to the first layer that claims it (`Capability.claims`), and what nobody claims to the last
    layer. Orders to parts of others are not carried out. A layer that loses parts is told so (`pause`), and
    also when they come back (`resume`).

    Raises TciError for a layer that is no capability, or that does not tell what it claims, unless it is the
    last one.
    """

    layers: Sequence[Capability[Any]]
    """The capabilities, the highest priority first."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "layers", tuple(self.layers))
        if not self.layers:
            raise TciError("an arbiter without layers; valid: at least one capability")
        for layer in self.layers:
            if not isinstance(layer, Capability):
                raise TciError(f"arbiter: {named(layer)} as a layer; valid: instances of tci.Capability")
        for layer in self.layers[:-1]:
            if not tells_claims(layer):
                raise TciError(
                    f"arbiter: {type(unwrapped(layer)).__name__} does not tell which parts it holds; valid: "
                    "as the last layer, or with a method claims(memory) that returns their names"
                )

    @property
    def needs(self) -> tuple[Need, ...]:
        return tuple(need for layer in self.layers for need in layer.needs)

    def init(self, body: GenericBody) -> ArbiterMemory:
        return ArbiterMemory(tuple(Layer(layer.init(body)) for layer in self.layers))

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """The first orders of the last layer, which has all parts at first. Those of the others follow when
        they get a part. Raises CommandError if the robot lacks a mode that one of them needs."""
        for layer in self.layers[:-1]:
            check_modes(layer, begin_of(layer, perception, body), body)
        return begin_of(self.layers[-1], perception, body)

    def step(
        self, memory: ArbiterMemory, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], ArbiterMemory]:
        """Raises CommandError if a layer commands the robot's own joints, because their generic part is
        unknown."""
        taken = memory.taken
        after: list[Layer] = []
        granted: list[Order] = []
        for capability, before in zip(self.layers, memory.layers, strict=True):
            orders, layer = step_layer(capability, before, taken, perception, body)
            after.append(layer)
            own = layer.claims if len(after) < len(self.layers) else None
            for order in orders:
                if not isinstance(order, Command):
                    raise CommandError(
                        f"arbiter: {type(unwrapped(capability)).__name__} commands the robot's own joints; "
                        "valid: commands to generic parts"
                    )
                if order.part not in taken and (own is None or order.part in own):
                    granted.append(order)
            taken |= layer.claims
        return tuple(with_modes(granted, memory.layers, after)), replace(memory, layers=tuple(after))

    def claims(self, memory: ArbiterMemory) -> frozenset[str]:
        return frozenset().union(*(layer.claims for layer in memory.layers))

    def pause(
        self, memory: ArbiterMemory, taken: frozenset[str], perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], ArbiterMemory]:
        """The layers are told in the step that follows."""
        return (), replace(memory, taken=taken)

    def resume(
        self,
        memory: ArbiterMemory,
        taken: frozenset[str],
        last: tuple[Order, ...],
        perception: Perception,
        body: GenericBody,
    ) -> tuple[tuple[Order, ...], ArbiterMemory]:
        """The layers are told in the step that follows."""
        return (), replace(memory, taken=taken)

    def notes(self, memory: ArbiterMemory) -> tuple[str, ...]:
        """Which layer holds what, and the notes of all layers but those whose parts others hold."""
        pairs = [
            (capability, layer)
            for capability, layer in zip(self.layers, memory.layers, strict=True)
            if not layer.claims or layer.claims - layer.taken
        ]
        holds = [
            f"{type(unwrapped(capability)).__name__} holds {', '.join(sorted(layer.claims - layer.taken))}"
            for capability, layer in pairs
            if layer.claims and capability is not self.layers[-1]
        ]
        return (*holds, *(note for capability, layer in pairs for note in capability.notes(layer.memory)))

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """The first reason of a layer to stop the robot."""
        return next(filter(None, (layer.fault(perception, body) for layer in self.layers)), None)


def tells_claims(capability: Capability[Any]) -> bool:
    own = type(capability).claims
    if isinstance(capability, CapabilityWrapper) and own is CapabilityWrapper.claims:
        return tells_claims(capability.inner)
    if isinstance(capability, Arbiter):
        return tells_claims(capability.layers[-1])
    return own is not Capability.claims
