"""What holds for every capability: frozen settings, a memory of plain data, and equal results for equal
arguments, however the arguments were stored in between."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import fields, is_dataclass
from functools import partial
from importlib.metadata import entry_points
from typing import Any

import numpy as np
import pytest
from py_trees.composites import Selector

import tci
from helpers.turning import Turn
from tci.capabilities import Companion
from tci.capabilities.behaviour_tree import BehaviourTree, Reflex, Task
from tci.capabilities.policy import PolicySpec
from tci.gestures.gesture import Gesture, fit
from tci.messages import Mode, Order, Perception
from tci.runtime.arguments import load_capability
from tci.testing import TouchedRobot

TOUCHES = [None, "left_forearm", "left_forearm", None, None, "right_upper_arm", "head_skin", None, None, None]
PALM = [None, "left_palm", "left_palm", "left_palm", None, "left_thumb_tip", None, None, None, None]
HAND = [None, "left_hand", "left_hand", None, *[None] * 20]
COURSES = {
    "light-grasp": ("nao-hands", PALM),
    "finger-reflex": ("nao-hands", PALM),
    "soft-hands": ("nao-plain", HAND),
}
ONLY_TELLS = {"touch-words"}
"""Capabilities that move nothing."""
REGISTERED: dict[str, Callable[[], tci.Capability[Any]]] = {
    point.name: partial(load_capability, point.name) for point in entry_points(group="tci.capabilities")
}


def gesture() -> tci.PlayGesture:
    still = np.deg2rad(np.array([25.0, 25, 0, 60, 0]) + np.zeros((21, 1)))
    return tci.PlayGesture(
        fit(tci.load_robot("nao-whole"), Gesture(np.linspace(0.0, 1.0, 21), {"left_arm": still}))
    )


def away(seen: np.ndarray) -> np.ndarray:
    return np.tile([0.0, 0.1, 0.0, 0.2, 0.0], (2, 1)) * np.abs(seen).max()


MADE: dict[str, Callable[[], tci.Capability[Any]]] = {
    **REGISTERED,
    "companion": Companion,
    "by velocity": lambda: tci.WithdrawalReflex(mode=Mode.VELOCITY),
    "lying": lambda: tci.BodyWithdrawal(stance="supported", refractory=0.05),
    "soft in torque mode": lambda: tci.SoftReaction(mode=Mode.TORQUE),
    "gesture": gesture,
    "policy": lambda: tci.PolicyCapability(away, PolicySpec(history=3, chunk=2, rate=25.0, latency=0.04)),
    "nothing changed": lambda: tci.CapabilityWrapper(tci.WithdrawalReflex()),
    "contact stop": lambda: tci.ContactStop(tci.WithdrawalReflex(), quiet=0.05),
    "reflex above a gesture": lambda: tci.Arbiter([tci.WithdrawalReflex(refractory=0.05), gesture()]),
    "reflex above a velocity": lambda: tci.Arbiter([tci.WithdrawalReflex(refractory=0.05), Turn()]),
    "three": lambda: tci.Arbiter([tci.SoftReaction(), tci.Arbiter([tci.BodyWithdrawal(), gesture()])]),
}
STORED: dict[str, Callable[[Any], Any]] = {
    "deep copy": deepcopy,
    "pickle": lambda one: pickle.loads(pickle.dumps(one)),
}


def course(name: str) -> tuple[tci.GenericBody, list[Perception]]:
    which, touched = COURSES.get(name, ("nao-whole", TOUCHES))
    robot = TouchedRobot(which)
    touches = [touch for touch in touched for _ in range(3)]
    return robot.body, [robot.perceive(touch, force=4.0) for touch in touches]


def content(value: object) -> Iterator[bytes]:
    """The numbers and words in a value, as bytes. Fails for anything that is no plain data."""
    if is_dataclass(value) and not isinstance(value, type):
        assert value.__dataclass_params__.frozen, f"{type(value).__name__} can be changed"  # type: ignore[attr-defined]
        for one in fields(value):
            yield from content(getattr(value, one.name))
    elif isinstance(value, Mapping):
        for name in sorted(value, key=repr):
            yield from content(name)
            yield from content(value[name])
    elif isinstance(value, np.ndarray):
        yield value.tobytes()
    elif isinstance(value, set | frozenset):
        yield repr(sorted(value, key=repr)).encode()
    elif isinstance(value, list | tuple):
        yield str(len(value)).encode()
        for one in value:
            yield from content(one)
    else:
        assert (
            value is None
            or isinstance(value, bool | int | float | str | bytes | Mode | np.generic)
            or (type(value).__module__.startswith("tci.") and not callable(value))
        ), f"{value!r} is no plain data"
        yield repr(value).encode()


def told(value: object) -> bytes:
    return b"|".join(content(value))


def results(
    capability: tci.Capability[Any], memory: Any, seen: Perception, body: tci.GenericBody
) -> list[tuple[Any, Any]]:
    """What every method returns for these arguments, each with the memory after it."""
    taken, none = frozenset({"left_arm", "head"}), frozenset[str]()
    last: tuple[Order, ...] = (tci.GenericCommand("left_arm", Mode.POSITION, np.zeros(5)),)
    return [
        capability.step(memory, seen, body),
        capability.pause(memory, taken, seen, body),
        capability.resume(memory, none, last, seen, body),
        (capability.claims(memory), memory),
        (capability.notes(memory), memory),
        (capability.fault(seen, body), memory),
        (capability.begin(seen, body), memory),
    ]


@pytest.mark.parametrize("stored", STORED.values(), ids=list(STORED))
@pytest.mark.parametrize("name", MADE)
def test_equal_arguments_give_equal_results_and_stay_as_they_are(
    name: str, stored: Callable[[Any], Any]
) -> None:
    body, perceptions = course(name)
    capability = MADE[name]()
    memory = capability.init(body)
    orders = paused = 0
    for n, seen in enumerate(perceptions):
        before = told(memory), told(seen)
        first = results(capability, memory, seen, body)
        again = results(MADE[name](), stored(memory), stored(seen), body)
        assert [told(one) for one in first] == [told(one) for one in again]
        assert (told(memory), told(seen)) == before, "arguments are not changed"
        orders += len(first[0][0])
        if n in (8, 17):  # a layer above takes parts, and gives them back
            taken = frozenset({"left_arm"}) if n == 8 else frozenset[str]()
            _, memory = (
                capability.pause(memory, taken, seen, body)
                if taken
                else (capability.resume(memory, taken, (), seen, body))
            )
            paused += 1
        _, memory = capability.step(memory, seen, body)
        assert capability.claims(memory) <= {part.name for part in body.robot.parts}
    assert bool(orders) is (name not in ONLY_TELLS)
    assert paused == 2


@pytest.mark.parametrize("name", MADE)
def test_settings_are_frozen(name: str) -> None:
    capability = MADE[name]()
    if is_dataclass(capability):
        with pytest.raises(AttributeError):
            setattr(capability, next(iter(fields(capability))).name, None)


@pytest.mark.parametrize("name", REGISTERED)
def test_a_registered_capability_claims_what_it_moves(name: str) -> None:
    """As a layer above others, it could not move what it does not claim."""
    body, perceptions = course(name)
    arbiter = tci.Arbiter([MADE[name](), Turn()])
    capability, memory = MADE[name](), MADE[name]().init(body)
    moved = 0
    for seen in perceptions:
        orders, memory = capability.step(memory, seen, body)
        claims = capability.claims(memory)
        # an arm at rest of a soft reaction is told to stay at rest
        moving = {
            order.part
            for order in orders
            if isinstance(order, tci.GenericCommand) and (np.any(order.values) or order.mode is Mode.POSITION)
        }
        assert moving <= claims
        moved += len(moving)
    assert bool(moved) is (name not in ONLY_TELLS)
    assert arbiter.init(body)


def test_a_tree_goes_on_with_the_memory_of_its_leaves() -> None:
    """A tree of py-trees is no plain data; a new tree gives the same orders."""
    body, perceptions = course("tree")

    def tree() -> Selector:
        task = Task("turn", Turn(), done=lambda memory, perception: False)
        return Selector("both", memory=False, children=[Reflex("away", tci.WithdrawalReflex()), task])

    runs = []
    for _ in range(2):
        capability = BehaviourTree(tree)
        memory, orders = capability.init(body), []
        for seen in perceptions:
            given, memory = capability.step(memory, seen, body)
            orders.append(told(given))
        runs.append(orders)
    assert runs[0] == runs[1]
