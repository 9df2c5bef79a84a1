"""Capabilities in a behaviour tree of py-trees: a reflex interrupts a task, which then continues."""

from dataclasses import dataclass

import numpy as np
from py_trees.composites import Selector

import tci
from tci.capabilities.behaviour_tree import BehaviourTree, Reflex, Task


@dataclass(frozen=True)
class LookAround(tci.Capability[int]):
    """Turns the head alternately to the left and to the right."""

    def init(self, body) -> int:
        return 0

    def step(self, memory, perception, body):
        side = 0.4 if memory // 250 % 2 == 0 else -0.4  # [rad], a new side every 250 periods
        turn = tci.GenericCommand("head", tci.Mode.POSITION, np.array([side, 0.0, 0.0]))
        return ((turn,) if memory % 250 == 0 else ()), memory + 1


def tree():
    looking = Task("look around", LookAround(), done=lambda count, perception: count >= 1000)
    return Selector("nao", memory=False, children=[Reflex("withdraw", tci.WithdrawalReflex()), looking])


last = ""


def tell(tick: tci.Tick) -> None:
    global last
    for command in tick.commands:
        if isinstance(command, tci.GenericCommand) and command.part != last:
            last = command.part
            print(f"{tick.now:.3f} s: {last}")


with tci.connect(tci.load_robot("nao"), "sim") as driver:
    driver.world.finger.poke("left_forearm", 150, speed=0.25, depth=0.01, gap=0.1)
    tci.run(driver, BehaviourTree(tree), duration=3.0, observe=tell)
