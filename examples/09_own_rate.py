"""Runs your own loop at 50 Hz, 100 Hz and 1 kHz. The arm takes equally long at each rate, because its limits
determine the time."""

import numpy as np

import tci

robot = tci.load_robot("nao")
posture = robot.part("left_arm").initial_posture.copy()
posture[0] += np.deg2rad(30.0)
wanted, body = tci.GenericCommand("left_arm", tci.Mode.POSITION, posture), tci.GenericBody(robot)


def move(driver: tci.Driver, every: int) -> float:
    """Moves the arm, and returns the time [s] that it took. A decision is made in every `every`-th step."""
    for step, now in enumerate(driver.ticks(duration=2.0)):
        joints = driver.read().joints
        orders, _ = body.to_platform([wanted] if step % every == 0 else [], joints)
        sent = driver.write(driver.gate.step(orders, joints, now))
        if now > 0.05 and np.abs(sent.velocity).max(initial=0.0) < 1e-3:
            return now
    raise TimeoutError("the arm still moves")


# The gate plans the motion until its next step, so the driver must know how often you call the gate.
for rate in (50.0, 100.0, 1000.0):
    with tci.connect(robot, "sim", rate=rate) as driver:
        print(f"loop at {rate:.0f} Hz: 30 degrees in {move(driver, every=1):.2f} s")

# If the driver has a fixed rate, your capability decides at your rate, and the gate steps at the driver's.
with tci.connect(robot, "sim") as driver:
    taken = move(driver, every=round(0.02 / driver.period))
    print(f"decisions at 50 Hz, steps at {1.0 / driver.period:.0f} Hz: 30 degrees in {taken:.2f} s")
