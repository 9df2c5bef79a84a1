"""Calls of a capability's methods, with checks of what they return.

The loop uses these functions, and so does a capability that runs another capability inside. A single command
in place of a tuple is put in a tuple. Any other type is refused, by the name of the class that returned it.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, Memory
from tci.errors import CommandError
from tci.messages import CONTROL_MODES, CartesianCommand, GenericCommand, Order, Perception


def begin_of(capability: Capability[Memory], perception: Perception, body: GenericBody) -> tuple[Order, ...]:
    return as_orders(capability.begin(perception, body), f"{type(capability).__name__}: begin")


def step_of(
    capability: Capability[Memory], memory: Memory, perception: Perception, body: GenericBody
) -> tuple[tuple[Order, ...], Memory]:
    return _pair(capability.step(memory, perception, body), capability, "step")


def pause_of(
    capability: Capability[Memory],
    memory: Memory,
    taken: frozenset[str],
    perception: Perception,
    body: GenericBody,
) -> tuple[tuple[Order, ...], Memory]:
    return _pair(capability.pause(memory, taken, perception, body), capability, "pause")


def resume_of(
    capability: Capability[Memory],
    memory: Memory,
    taken: frozenset[str],
    last: tuple[Order, ...],
    perception: Perception,
    body: GenericBody,
) -> tuple[tuple[Order, ...], Memory]:
    return _pair(capability.resume(memory, taken, last, perception, body), capability, "resume")


def claims_of(capability: Capability[Memory], memory: Memory) -> frozenset[str]:
    claims: object = capability.claims(memory)
    if isinstance(claims, str) or not isinstance(claims, Iterable):
        source = f"{type(capability).__name__}: claims"
        raise CommandError(f"{source} returned {named(claims)}; valid: a set of names of generic parts")
    return frozenset(claims)


def _pair(answer: object, capability: Capability[Any], method: str) -> tuple[tuple[Order, ...], Any]:
    """Raises CommandError unless `answer` is the pair (commands, memory)."""
    source = f"{type(capability).__name__}: {method}"
    if isinstance(answer, tuple) and len(answer) == 2:
        commands, after = answer
        if not (isinstance(commands, Order) and isinstance(after, Order)):
            return as_orders(commands, source), after
    gave = "two commands" if isinstance(answer, tuple) and len(answer) == 2 else type(answer).__name__
    raise CommandError(f"{source} returned {gave}; valid: the pair (commands, memory)")


def moved_part(order: Order) -> str:
    """Name of the generic part that an order moves; empty if it moves nothing, or the robot's own joints."""
    if isinstance(order, CartesianCommand) or (
        isinstance(order, GenericCommand) and order.mode in CONTROL_MODES
    ):
        return order.part
    return ""


def as_orders(given: object, source: str) -> tuple[Order, ...]:
    """Returns the commands of a capability as a tuple, also if `given` is a single command.

    `source` is the name of the capability and its method, for the message of an error. Raises CommandError
    for an object that is not a command.
    """
    if isinstance(given, tuple) and not given:
        return given
    orders = (given,) if isinstance(given, Order) or not isinstance(given, Iterable) else tuple(given)
    for order in orders:
        if not isinstance(order, Order):
            raise CommandError(
                f"{source} returned {named(order)} as a command; valid: a tuple of commands, () for none"
            )
    return orders


def named(given: object) -> str:
    """Describes an object for a message: `the class Shrug`, `a Robot`, `the word 'nao'`."""
    if isinstance(given, type):
        return f"the class {given.__name__}"
    if isinstance(given, str):
        return f"the word {given!r}"
    name = type(given).__name__
    return "None" if given is None else f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"
