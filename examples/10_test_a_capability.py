"""Tests a capability without a robot and without a simulation: checks its command after a touch."""

import numpy as np

import tci
from tci.testing import TouchedRobot

robot, reflex = TouchedRobot("nao"), tci.WithdrawalReflex()

nothing, memory = reflex.step(reflex.init(robot.body), robot.perceive(), robot.body)
assert nothing == ()

(command,), memory = reflex.step(memory, robot.perceive("left_forearm", force=4.0), robot.body)
assert isinstance(command, tci.GenericCommand)
assert command.part == "left_arm"
print("touched on its left forearm it wants", np.round(np.rad2deg(command.values), 1), "degrees")

commands, _ = reflex.step(reflex.init(robot.body), robot.perceive("head"), robot.body)
assert commands == (), "it knows nothing of heads, and passes over the touch"

robot = TouchedRobot("nao", posture={"right_arm": np.deg2rad([40.0, 20.0, 0.0, 70.0, 0.0])})
for touch in ("right_forearm", "right_forearm", None):
    seen = robot.perceive(touch, force=4.0)
    contacts = [(contact.patch, round(contact.force, 1), contact.identity) for contact in seen.contacts]
    print(f"{seen.stamp:.2f} s: {contacts}, ended: {seen.ended}")
