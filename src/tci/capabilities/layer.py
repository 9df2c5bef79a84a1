"""One capability beside others that move the same parts. `Arbiter` and `BehaviourTree` are made of these."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.orders import begin_of, claims_of, pause_of, resume_of, step_of
from tci.capabilities.wrapper import unwrapped
from tci.errors import CommandError
from tci.messages import CartesianCommand, GenericCommand, Mode, Order, Perception, SwitchMode
from tci.robot.joint_map import joint_map

SHARES = (Mode.STIFFNESS, Mode.DAMPING)
ANGLES = (Mode.POSITION, Mode.IMPEDANCE)
"""Modes whose targets may be ordered again. A velocity or torque was meant for its instant only."""
Motion = GenericCommand | CartesianCommand | SwitchMode
Wanted = Mapping[tuple[str, Mode | None], Motion]
"""What a capability last ordered, by part: under None its last motion or change of the mode, under STIFFNESS
and DAMPING its last such order."""


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """What is remembered of one capability beside others."""

    memory: Any
    """Memory of the capability."""
    wanted: Wanted | None = None
    """What it last ordered, carried out or not. None before its first step."""
    claims: frozenset[str] = frozenset()
    """Parts that it claims."""
    taken: frozenset[str] = frozenset()
    """Parts that others hold, against it."""

    def last(self, part: str) -> Motion | None:
        """Its last order that moves a part or changes its mode."""
        return (self.wanted or {}).get((part, None))

    @property
    def moved(self) -> frozenset[str]:
        """Parts that it ordered to move, or to change their mode."""
        return frozenset(part for part, kind in self.wanted or () if kind is None)


def step_layer(
    capability: Capability[Any],
    layer: Layer,
    taken: frozenset[str],
    perception: Perception,
    body: GenericBody,
) -> tuple[tuple[Order, ...], Layer]:
    """One step of a capability, after `resume` and `pause` if `taken` is not what it was. Its first orders
    (`begin`) to a part come again when it claims this part, and when the part comes back."""
    memory, wanted = layer.memory, layer.wanted
    if wanted is None:
        wanted = _with_orders({}, begin_of(capability, perception, body))
    orders: tuple[Order, ...] = ()
    if back := layer.taken - taken:
        again = tuple(chain.from_iterable(_again(wanted, part) for part in sorted(back)))
        orders, memory = resume_of(capability, memory, taken, again, perception, body)
    if taken - layer.taken:
        paused, memory = pause_of(capability, memory, taken, perception, body)
        orders += paused
    given, memory = step_of(capability, memory, perception, body)
    claims = claims_of(capability, memory)
    new = sorted(claims - layer.claims)
    orders = (*chain.from_iterable(_ready(wanted, part) for part in new), *orders, *given)
    return orders, Layer(memory, _with_orders(wanted, orders), claims, taken)


def _with_orders(wanted: Wanted, orders: Iterable[Order]) -> Wanted:
    new: dict[tuple[str, Mode | None], Motion] = {}
    for order in orders:
        if isinstance(order, GenericCommand) and order.mode in SHARES:
            new[order.part, order.mode] = order
        elif isinstance(order, Motion):
            new[order.part, None] = order
    return {**wanted, **new} if new else wanted


def _ready(wanted: Wanted, part: str) -> Iterator[Motion]:
    """The mode, stiffness and damping in which a capability moves a part."""
    if (part, None) in wanted:
        yield SwitchMode(part, _mode(wanted[part, None]))
    yield from (wanted[part, share] for share in SHARES if (part, share) in wanted)


def _again(wanted: Wanted, part: str) -> Iterator[Motion]:
    """What brings a part that came back to where a capability left it."""
    yield from _ready(wanted, part)
    last = wanted.get((part, None))
    if last is not None and not isinstance(last, SwitchMode) and _mode(last) in ANGLES:
        yield last


def _mode(order: Motion) -> Mode:
    return Mode.POSITION if isinstance(order, CartesianCommand) else order.mode


def with_modes(orders: Iterable[Order], before: Sequence[Layer], after: Sequence[Layer]) -> Iterator[Order]:
    """The orders that are carried out, with a switch in front of each motion of a part that layers move in
    different modes, or that none of them moved before. It is repeated with each motion: a switch to the
    present mode changes nothing, and one that was refused while the gate held is made up for.

    Args:
        orders: What is carried out of the layers' orders.
        before: The layers before this step.
        after: The layers after it.
    """
    switched: dict[str, Mode] = {}
    for order in orders:
        if not isinstance(order, Motion) or (isinstance(order, GenericCommand) and order.mode in SHARES):
            yield order
            continue
        part, mode = order.part, _mode(order)
        if switched.get(part) is not mode:
            known = any(layer.last(part) for layer in before)
            modes = {_mode(last) for layer in after if (last := layer.last(part))}
            if isinstance(order, SwitchMode) or not known or len(modes) > 1:
                switched[part] = mode
                yield SwitchMode(part, mode)
        if not isinstance(order, SwitchMode):
            yield order


def check_modes(capability: Capability[Any], begun: Iterable[Order], body: GenericBody) -> None:
    """Raises CommandError if the robot lacks a mode to which the first orders of a capability switch, for
    switches that come later."""
    for order in (one for one in begun if isinstance(one, SwitchMode)):
        for servo in (body.robot.servos[index] for index in joint_map(body.robot, order.part).servos):
            if order.mode not in servo.modes:
                name, valid = type(unwrapped(capability)).__name__, [mode.value for mode in servo.modes]
                raise CommandError(
                    f"{name} needs {order.part} in {order.mode.value} mode; valid for {servo.name}: "
                    f"{', '.join(valid)}"
                )
