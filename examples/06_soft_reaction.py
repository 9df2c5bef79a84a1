"""A soft arm: a push moves the arm in the direction of the force, which the transposed Jacobian maps to joint
motions."""

import numpy as np

import tci

robot = tci.load_robot("nao")
body = tci.GenericBody(robot)
with tci.connect(robot, "sim") as driver:
    start = body.posture(driver.read().joints)["left_arm"]
    driver.world.finger.poke("left_forearm", 100, speed=0.05, depth=0.02)
    tci.run(driver, tci.SoftReaction(), duration=0.8)
    bent = body.posture(driver.read().joints)["left_arm"] - start
    print("joints went along by", np.round(np.rad2deg(bent), 1), "degrees")
    print(f"largest force {driver.world.finger.peak_force:.1f} N")
