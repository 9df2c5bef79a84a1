"""Capabilities combined in a behaviour tree, which replaces the paper's task description language (TDL).

A tree consists of selectors, sequences, parallels and decorators of the package py-trees (see its
manual). TCI adds leaves that run capabilities, and the capability `BehaviourTree`, which ticks the tree::

    def tree():
        return Selector("arm", memory=False, children=[
            Reflex("withdraw", WithdrawalReflex()),
            Task("wave", Wave(), done=lambda memory, perception: memory.count == 3),
        ])

    tci.run(driver, BehaviourTree(tree))

In this example the reflex is ticked first. While the reflex is busy, the task is interrupted. When the reflex
has finished, the task continues.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from tci.body.generic_body import GenericBody
from tci.capabilities.arbiter import tells_claims
from tci.capabilities.capability import Capability
from tci.capabilities.layer import Layer, check_modes, step_layer, with_modes
from tci.capabilities.needs import Need
from tci.capabilities.orders import begin_of, moved_part, pause_of
from tci.errors import TciError
from tci.messages import Command, Order, Perception, SwitchMode
from tci.reasons import Reason
from tci.support.installed import needs

with needs("a behaviour tree", "behaviours"):
    from py_trees.behaviour import Behaviour
    from py_trees.common import Status

__all__ = ["BehaviourTree", "Reflex", "Task"]


class Leaf(Behaviour):
    """A leaf of a tree that runs a capability. If the leaf is interrupted, the memory of the capability stays
    unchanged."""

    def __init__(self, name: str, capability: Capability[Any]) -> None:
        super().__init__(name)
        self.capability = capability
        self.layer = Layer(None)
        """The capability's memory, and what it last ordered."""
        self.seen: tuple[Perception, GenericBody] | None = None
        """Perception of this tick, and the generic body. The value is None if the leaf is not in a
        `BehaviourTree`."""
        self.orders: list[Order] = []
        """Orders of the capability in this tick."""

    @property
    def memory(self) -> Any:
        """Memory of the capability."""
        return self.layer.memory

    @property
    def holds(self) -> frozenset[str]:
        """Parts that it holds: those that its capability claims, or else those that it moved."""
        if self.status is not Status.RUNNING:
            return frozenset()
        return self.layer.claims if tells_claims(self.capability) else self.layer.moved

    def _now(self) -> tuple[Perception, GenericBody]:
        if self.seen is None:
            raise TciError(f"the leaf {self.name!r} was ticked outside of a BehaviourTree; valid: within one")
        return self.seen

    def _step(self) -> Perception:
        perception, body = self._now()
        orders, self.layer = step_layer(self.capability, self.layer, frozenset(), perception, body)
        self.orders += orders
        return perception


class Reflex(Leaf):
    """A leaf with a capability that is active only from time to time, such as a withdrawal reflex.

    The status of the leaf is RUNNING while the capability is busy, else FAILURE. The capability gets touches
    only in ticks that reach this leaf. So put the leaf first, in a selector without memory.
    """

    def __init__(self, name: str, capability: Capability[Any], *, busy: Callable[[Any], bool] = bool) -> None:
        """Creates a leaf. `busy` is a function of the memory that returns True while the capability moves a
        part."""
        super().__init__(name, capability)
        self._busy = busy

    def update(self) -> Status:
        self._step()
        return Status.RUNNING if self._busy(self.memory) else Status.FAILURE


class Task(Leaf):
    """Leaf with a capability that runs until the task is done.

    The status of the leaf is RUNNING until the task is done, and then SUCCESS. If the leaf is ticked after
    SUCCESS, the capability starts from the beginning. After an interruption, the capability continues with
    its memory, and its last command to each part is sent again.
    """

    def __init__(
        self, name: str, capability: Capability[Any], *, done: Callable[[Any, Perception], bool]
    ) -> None:
        """Creates a leaf. `done` is a function of memory and perception that returns True when the task is
        finished."""
        super().__init__(name, capability)
        self._done = done
        self._interrupted = False

    def initialise(self) -> None:
        if not self._interrupted:
            self.layer = Layer(self.capability.init(self._now()[1]))
        self._interrupted = False

    def update(self) -> Status:
        seen = self._step()
        return Status.SUCCESS if self._done(self.memory, seen) else Status.RUNNING

    def terminate(self, new_status: Status) -> None:
        self._interrupted = new_status is Status.INVALID and self.status is Status.RUNNING
        if self._interrupted:
            parts = self.layer.moved
            _, memory = pause_of(self.capability, self.memory, parts, *self._now())
            self.layer = replace(self.layer, memory=memory, taken=parts)


@dataclass(frozen=True)
class BehaviourTree(Capability[Behaviour]):
    """A capability that ticks a behaviour tree. Raises TciError for a tree without any `Task` or `Reflex`.

    The memory of this capability is the tree, and each step changes the tree in place. So call `init` for a
    new tree before a replay.
    """

    tree: Callable[[], Behaviour]
    """Function that returns a new tree in each call."""

    def __post_init__(self) -> None:
        if not any(_leaves(self.tree())):
            raise TciError("a behaviour tree without a Task or a Reflex; valid: at least one")

    @property
    def needs(self) -> tuple[Need, ...]:
        return tuple(need for leaf in _leaves(self.tree()) for need in leaf.capability.needs)

    def init(self, body: GenericBody) -> Behaviour:
        tree = self.tree()
        for leaf in _leaves(tree):
            leaf.layer = Layer(leaf.capability.init(body))
        return tree

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        """Returns the first orders of all leaves. If leaves need a part in different modes, the first mode;
        the part then changes its mode with the leaf that moves it. Raises CommandError if the robot lacks one
        of these modes."""
        begun: list[Order] = []
        modes: dict[str, SwitchMode] = {}
        for leaf in _leaves(self.tree()):
            orders = begin_of(leaf.capability, perception, body)
            check_modes(leaf.capability, orders, body)
            for order in orders:
                if not isinstance(order, SwitchMode) or modes.setdefault(order.part, order) is order:
                    begun.append(order)
        return tuple(begun)

    def step(
        self, memory: Behaviour, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Order, ...], Behaviour]:
        """Ticks the tree once. If several leaves move one part, only the orders of the first leaf are
        used."""
        leaves = list(_leaves(memory))
        before = [leaf.layer for leaf in leaves]
        for leaf in leaves:
            leaf.seen, leaf.orders = (perception, body), []
        memory.tick_once()
        owner = {moved_part(order): leaf for leaf in reversed(leaves) for order in leaf.orders}
        orders = [
            order
            for leaf in leaves
            for order in leaf.orders
            if not isinstance(order, Command) or owner.get(order.part, leaf) is leaf
        ]
        return tuple(with_modes(orders, before, [leaf.layer for leaf in leaves])), memory

    def claims(self, memory: Behaviour) -> frozenset[str]:
        """What the running leaves hold."""
        return frozenset().union(*(leaf.holds for leaf in _leaves(memory)))

    def notes(self, memory: Behaviour) -> tuple[str, ...]:
        """Returns the notes of all leaves of the tree."""
        return tuple(note for leaf in _leaves(memory) for note in leaf.capability.notes(leaf.memory))

    def fault(self, perception: Perception, body: GenericBody) -> Reason | None:
        """Asks the leaves one after another for a reason to stop the robot, and returns the first reason.
        Returns None if no leaf has one."""
        reasons = (leaf.capability.fault(perception, body) for leaf in _leaves(self.tree()))
        return next(filter(None, reasons), None)


def _leaves(tree: Behaviour) -> Iterator[Leaf]:
    """Yields the leaves that run capabilities, in the order in which the tree is ticked."""
    if isinstance(tree, Leaf):
        yield tree
    for child in tree.children:
        yield from _leaves(child)
