"""A process that moves the NAO at `python commander.py VIA` until it is killed. It prints `moving`."""

from __future__ import annotations

import sys
from pathlib import Path

import tci

sys.path.insert(0, str(Path(__file__).parents[1]))
from middleware.patient import patient


def main() -> None:
    with tci.connect(patient("nao"), sys.argv[1], arm=True) as link:
        arm = link.native("LArm")
        elbow = next(servo.index for servo in arm.servos if servo.name == "LElbowRoll")
        goal, told = -0.4, False
        for now in link.ticks():
            joints = link.read().joints
            if abs(joints.position[elbow] - goal) < 0.05:
                goal = -1.4
            link.write(link.gate.step([arm.command({"LElbowRoll": goal}, speed=0.2)], joints, now))
            if goal == -1.4 and joints.position[elbow] < -0.7 and not told:
                told = True
                print("moving", flush=True)


if __name__ == "__main__":
    main()
