"""Steps a robot at the pace of a policy: ten decisions per second, from all that the skin felt in between."""

import numpy as np

import tci

robot = tci.load_robot("nao")


def policy(seen: tci.Perception, between: tuple[tci.Perception, ...]) -> list[tci.GenericCommand]:
    """Bends the elbow in time, and lets go for a moment after each touch, however short it was."""
    touched = any(c.force > 0.5 for one in (*between, seen) for c in one.contacts if c.part == "left_arm")
    posture = robot.part("left_arm").initial_posture.copy()
    posture[3] = 0.3 if touched else 0.8 + 0.3 * np.sin(2.0 * seen.stamp)  # [rad]
    return [tci.GenericCommand("left_arm", "position", posture)]


with tci.connect(robot, "sim") as driver, tci.Stepper(driver, period=0.1) as stepper:
    for step in range(20):
        seen = stepper.observe()  # 0.1 s after the last one; a real robot goes on meanwhile
        sent = stepper.act(policy(seen, stepper.missed))
        if sent.refusals or sent.reason:
            print(f"{seen.stamp:.1f} s: {sent.reason or sent.refusals[0]}")
        if step == 9:
            driver.world.finger.poke("left_forearm", 60, depth=0.002)
        if step == 11:
            driver.world.finger.retire()
    print(f"{stepper.report.ticks} periods, {stepper.lost} perceptions were not read in time")
print(stepper.result())
