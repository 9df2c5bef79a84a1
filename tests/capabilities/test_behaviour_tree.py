"""Capabilities in behaviour trees of py-trees: a reflex interrupts a task, which then continues."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
import pytest
from py_trees.behaviour import Behaviour
from py_trees.common import ParallelPolicy, Status
from py_trees.composites import Parallel, Selector, Sequence

import tci
from helpers.touches import BODY
from helpers.turning import Turn
from tci.body.generic_body import GenericBody
from tci.capabilities.behaviour_tree import BehaviourTree, Reflex, Task
from tci.capabilities.capability import Capability
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, TciError
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode
from tci.messages.frames import Array
from tci.runtime.loop import Tick, run


@dataclass(frozen=True)
class Go(Capability[int]):
    """Moves a part to a target with one command, and counts its own steps."""

    part: str
    where: tuple[float, ...]
    mode: Mode | None = None

    def init(self, body: GenericBody) -> int:
        return 0

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return () if self.mode is None else (SwitchMode(self.part, self.mode),)

    def step(self, memory: int, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], int]:
        wanted = GenericCommand(self.part, Mode.POSITION, np.array(self.where))
        return ((wanted,) if memory == 0 else ()), memory + 1


@dataclass(frozen=True)
class Startle(Capability[bool]):
    """Moves the left arm while any skin is touched."""

    def init(self, body: GenericBody) -> bool:
        return False

    def step(self, memory: bool, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], bool]:
        touched = bool(perception.contacts)
        away = GenericCommand("left_arm", Mode.POSITION, np.zeros(5))
        return ((away,) if touched and not memory else ()), touched


def seen(stamp: float = 0.0, *, touched: bool = False) -> Perception:
    return Perception(stamp, {"left_arm": np.zeros(5)}, (object(),) if touched else ())


def values(orders: tuple[Order, ...]) -> list[list[float]]:
    return [order.values.tolist() for order in orders if isinstance(order, GenericCommand)]


def steps(count: int) -> object:
    return lambda memory, perception: memory >= count


HIGH, LOW = (1.0, 0.1, 0.0, 0.5, 0.0), (0.2, 0.1, 0.0, 0.5, 0.0)


def interruptible() -> Behaviour:
    return Selector(
        "arm", memory=False,
        children=[Reflex("startle", Startle()), Task("raise", Go("left_arm", HIGH), done=steps(6))],
    )  # fmt: skip


def test_a_reflex_interrupts_a_task_and_hands_back() -> None:
    tree = BehaviourTree(interruptible)
    memory = tree.init(BODY)
    told, statuses = [], []
    for touched in (False, False, True, True, False, False, False):
        orders, memory = tree.step(memory, seen(touched=touched), BODY)
        told.append(values(orders))
        statuses.append(memory.children[1].status)
    high, away = [list(HIGH)], [[0.0] * 5]
    assert told == [high, [], away, [], high, [], []]
    assert statuses == [Status.RUNNING] * 2 + [Status.INVALID] * 2 + [Status.RUNNING] * 3
    assert memory.children[1].memory == 5


def test_a_task_that_is_done_starts_anew_when_it_is_ticked_again() -> None:
    def both() -> Behaviour:
        children = [Task("up", Go("left_arm", HIGH), done=steps(2)),
                    Task("down", Go("left_arm", LOW), done=steps(2))]  # fmt: skip
        return Sequence("wave", memory=True, children=children)

    tree = BehaviourTree(both)
    memory = tree.init(BODY)
    told = []
    for _ in range(6):
        orders, memory = tree.step(memory, seen(), BODY)
        told += values(orders)
    assert told == [list(HIGH), list(LOW), list(HIGH), list(LOW)]


def test_the_first_leaf_moves_a_part_that_two_want() -> None:
    def both() -> Behaviour:
        children = [
            Task(name, Go("left_arm", where), done=steps(9)) for name, where in (("a", HIGH), ("b", LOW))
        ]
        return Parallel("both", policy=ParallelPolicy.SuccessOnAll(), children=children)

    tree = BehaviourTree(both)
    assert values(tree.step(tree.init(BODY), seen(), BODY)[0]) == [list(HIGH)]


def test_a_part_changes_its_mode_with_the_leaf_that_moves_it() -> None:
    def modes(*wanted: Mode) -> BehaviourTree:
        leaves = [(f"leaf {n}", Go("left_arm", HIGH, mode)) for n, mode in enumerate(wanted)]
        return BehaviourTree(
            lambda: Sequence("s", memory=True, children=[Task(n, go, done=steps(1)) for n, go in leaves])
        )

    assert len(modes(Mode.VELOCITY, Mode.VELOCITY).begin(seen(), BODY)) == 1
    (begun,) = modes(Mode.VELOCITY, Mode.POSITION).begin(seen(), BODY)
    assert isinstance(begun, SwitchMode)
    assert begun.mode is Mode.VELOCITY
    with pytest.raises(CommandError, match="Go needs left_arm in torque mode; valid for LShoulderPitch"):
        modes(Mode.POSITION, Mode.TORQUE).begin(seen(), BODY)


def test_a_tree_without_leaves_and_a_leaf_without_a_tree_are_refused() -> None:
    with pytest.raises(TciError, match="at least one"):
        BehaviourTree(lambda: Sequence("empty", memory=True, children=[]))
    with pytest.raises(TciError, match="BehaviourTree"):
        Task("alone", Go("left_arm", HIGH), done=steps(1)).tick_once()


def test_on_a_robot_the_withdrawal_reflex_interrupts_and_the_same_run_gives_the_same_orders() -> None:
    def tree() -> Behaviour:
        nod = Task("nod", Go("head", (0.3, 0.0, 0.0)), done=lambda count, perception: count > 2000)
        return Selector("robot", memory=False, children=[Reflex("withdraw", tci.WithdrawalReflex()), nod])

    def once() -> tuple[list[str], list[bytes], Array]:
        states, told = [], []
        with SimulatedDriver(tci.load_robot("nao"), seed=4) as link:
            link.world.finger.poke("left_forearm", 150, speed=0.25, depth=0.01, gap=0.05)

            def watch(tick: Tick) -> None:
                told.append(
                    b"".join(o.values.tobytes() for o in tick.commands if isinstance(o, GenericCommand))
                )
                states.append("+".join(o.part for o in tick.commands if isinstance(o, GenericCommand)))

            run(link, BehaviourTree(tree), duration=2.0, observe=watch)
            return [s for s in states if s], told, link.read().joints.position

    first, second = once(), once()
    assert [part for part, _ in groupby(first[0])] == ["head", "left_arm", "head"]
    assert first[1] == second[1]
    assert np.array_equal(first[2], second[2])


def test_a_position_reflex_interrupts_a_velocity_task() -> None:
    """The gate refused the reflex at the touch: the task had the arm in another mode."""

    def tree() -> Behaviour:
        turn = Task("turn", Turn(), done=lambda memory, perception: False)
        return Selector("robot", memory=False, children=[Reflex("withdraw", tci.WithdrawalReflex()), turn])

    modes: list[Mode] = []
    with SimulatedDriver(tci.load_robot("nao")) as link:
        link.world.finger.poke("left_forearm", 150, speed=0.25, depth=0.01, gap=0.05)
        place = link.robot.servos.index(next(one for one in link.robot.servos if one.name == "LElbowRoll"))

        def watch(tick: Tick) -> None:
            shown = dict(zip(tick.sent.servos.tolist(), tick.sent.modes, strict=True))
            modes.append(shown.get(place, Mode.VELOCITY))

        result = run(link, BehaviourTree(tree), duration=1.5, observe=watch)
    assert not result.refusals
    assert [mode for mode, _ in groupby(modes)][:3] == [Mode.VELOCITY, Mode.POSITION, Mode.VELOCITY]
