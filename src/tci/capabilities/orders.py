"""Calls of `Capability.begin` and `Capability.step` with checks of the results.

The loop uses these functions, and so does a capability that runs another capability inside. If a method
returns a single command instead of a tuple, the command is put in a tuple. Any other type is refused.
"""

from __future__ import annotations

from collections.abc import Iterable

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability, Memory
from tci.errors import CommandError
from tci.messages import Order, Perception


def begin_of(capability: Capability[Memory], perception: Perception, body: GenericBody) -> tuple[Order, ...]:
    """Returns the first orders of a capability. Raises CommandError if an item is not an order (see
    `as_orders`)."""
    return as_orders(capability.begin(perception, body), f"{type(capability).__name__}: begin")


def step_of(
    capability: Capability[Memory], memory: Memory, perception: Perception, body: GenericBody
) -> tuple[tuple[Order, ...], Memory]:
    """Returns the commands of a capability's step, and the new memory.

    Raises CommandError if the step does not return a pair, or if one of the commands is not an order (see
    `as_orders`).
    """
    answer: object = capability.step(memory, perception, body)
    name = type(capability).__name__
    if isinstance(answer, tuple) and len(answer) == 2:
        commands, after = answer
        if not (isinstance(commands, Order) and isinstance(after, Order)):
            return as_orders(commands, f"{name}: step"), after
    gave = "two commands" if isinstance(answer, tuple) and len(answer) == 2 else type(answer).__name__
    raise CommandError(f"{name}: step returned {gave}; valid: the pair (commands, memory)")


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
