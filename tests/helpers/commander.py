"""Program that moves the NAO at `python -m helpers.commander VIA [SILENCE]` until it is killed. Prints
`moving` when the NAO moves."""

from __future__ import annotations

import sys

import tci
from helpers.patient import patient
from tci.runtime.priority import real_time_where_permitted


def main() -> None:
    robot = patient("nao", *map(float, sys.argv[2:]))
    with tci.connect(robot, sys.argv[1], arm=True) as driver, real_time_where_permitted():
        arm = driver.native("LArm")
        begun, told = arm.positions(driver.read().joints)["LElbowRoll"], False
        for now in driver.ticks():
            joints = driver.read().joints
            driver.write(driver.gate.step([arm.command({"LElbowRoll": -0.1}, speed=0.1)], joints, now))
            if not told and abs(arm.positions(joints)["LElbowRoll"] - begun) > 0.03:
                told = True
                print("moving", flush=True)


if __name__ == "__main__":
    main()
