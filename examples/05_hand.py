"""Moves a hand to a position relative to the shoulder, in arm lengths. The same numbers are used for every
robot."""

import numpy as np

import tci

TARGET = np.array([0.55, 0.10, -0.55])  # forward, left, up, in the arm's mount frame

robot = tci.load_robot("nao")
body = tci.GenericBody(robot)
with tci.connect(robot, "sim") as driver:
    for now in driver.ticks(duration=1.5):
        joints = driver.read().joints
        wanted = [tci.CartesianCommand("left_arm", TARGET)] if now == 0.0 else []
        orders, refused = body.to_platform(wanted, joints)
        driver.write(driver.gate.step(orders, joints, now, refused=refused))
    reach = body.reach("left_arm", "hand")
    missed = np.linalg.norm(reach.place(driver.read().joints.position) - TARGET) * reach.length
    print(f"{robot.name}: {1e3 * missed:.2f} mm from its target")
