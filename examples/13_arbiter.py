"""Priorities: a gesture pauses while a reflex above it has an arm, and goes on from where it paused."""

import numpy as np

import tci
from tci.capabilities import ArbiterMemory
from tci.gestures import Gesture, fit

robot = tci.load_robot("nao")
low, high = np.deg2rad([[25, 25, 0, 60, 0], [50, 35, 0, 60, 0]])  # the five generic joints of an arm
arms = {"left_arm": np.array([low, high, low]), "right_arm": np.array([low, high, low])}
gesture = Gesture(np.array([0.0, 1.0, 2.0]), arms)
layers = tci.Arbiter([tci.WithdrawalReflex(), tci.PlayGesture(fit(robot, gesture))])
told = ""


def tell(memory: ArbiterMemory) -> bool:
    """Prints what changes, and ends the run with the gesture."""
    global told
    play = memory.layers[-1].memory
    now = ", ".join((f"gesture: {play.phase.value}", *layers.notes(memory)))
    if now != told:
        told = now
        print(f"{now} ({play.time:.2f} s of the gesture)")
    return bool(play.phase.value == "done")


with tci.connect(robot) as driver:
    finger = driver.world.finger
    finger.poke("left_forearm", 150, speed=0.25, depth=0.01, gap=0.1)

    def leave(tick: tci.Tick) -> None:
        """Takes the finger away 0.2 s after its touch."""
        if finger.first_contact is not None and tick.now > finger.first_contact + 0.2:
            finger.retire()

    print(tci.run(driver, layers, duration=8.0, observe=leave, until=tell).summary)
