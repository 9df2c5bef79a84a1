"""Runs your own loop at 50 Hz, 100 Hz and 1 kHz. The arm takes equally long at each rate, because its limits
determine the time."""

import numpy as np

import tci
from tci.gate import SafeCommand

robot = tci.load_robot("nao")
posture = robot.part("left_arm").initial_posture.copy()
posture[0] += np.deg2rad(30.0)
wanted, body = tci.GenericCommand("left_arm", tci.Mode.POSITION, posture), tci.GenericBody(robot)


def at_rest(sent: SafeCommand) -> bool:
    return bool(np.abs(sent.velocity).max(initial=0.0) < 1e-3)


# The gate plans the motion until its next step, so the driver must know how often you call the gate.
for rate in (50.0, 100.0, 1000.0):
    with tci.connect(robot, "sim", rate=rate) as driver:
        for now in driver.ticks(duration=2.0):
            joints = driver.read().joints
            orders, _ = body.to_platform([wanted] if now == 0.0 else [], joints)
            sent = driver.write(driver.gate.step(orders, joints, now))
            if now > 0.05 and at_rest(sent):
                break
        print(f"loop at {rate:.0f} Hz: 30 degrees in {now:.2f} s")

# Use these lines if the driver has a fixed rate: your capability decides at your rate, and the gate steps at
# the rate of the driver.
with tci.connect(robot, "sim") as driver:
    often = round(0.02 / driver.period)
    for tick, now in enumerate(driver.ticks(duration=2.0)):
        joints = driver.read().joints
        orders, _ = body.to_platform([wanted] if tick % often == 0 else [], joints)  # 50 times per second
        sent = driver.write(driver.gate.step(orders, joints, now))
        if now > 0.05 and at_rest(sent):
            break
    print(f"decisions at 50 Hz, steps at {1.0 / driver.period:.0f} Hz: 30 degrees in {now:.2f} s")
