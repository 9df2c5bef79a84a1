"""Native joints: moves iCub's wrist with the names of iCub's own joints. The commands pass through the
gate."""

import numpy as np

import tci

robot = tci.load_robot("icub")
with tci.connect(robot, "sim") as driver:
    arm = driver.native("left_arm")
    commands = [arm.command({"l_wrist_pitch": np.deg2rad(-30), "l_wrist_yaw": np.deg2rad(90)})]
    for now in driver.ticks(duration=1.0):
        sent = driver.write(driver.gate.step(commands, driver.read().joints, now))
        commands = []
        for message in (*sent.refusals, *sent.clamped):
            print(message)
    wrist = arm.positions(driver.read().joints)
    print(f"wrist pitch is at {np.rad2deg(wrist['l_wrist_pitch']):.1f} degrees")
