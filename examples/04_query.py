"""Queries a robot at run time: limits, kinematics, and exports for other libraries."""

import numpy as np

import tci
from tci.exports import query, to_urdf
from tci.robot import KinematicChain, initial_position

robot = tci.load_robot("nao")
facts = query(robot)
for limits in facts.generic_limits["left_arm"]:
    if limits.lower is not None and limits.upper is not None:  # None: the robot has no such joint
        low, high = np.rad2deg([limits.lower, limits.upper])
        print(f"{limits.joint:>15}: {low:7.1f} .. {high:6.1f} degrees")

kinematics = KinematicChain(robot)
hand = kinematics.poses(initial_position(robot), ["LHand"])["LHand"]  # T_TL (4, 4), in the torso frame
print("left hand at", np.round(hand[:3, 3], 3), "m")

table = facts.denavit_hartenberg[0]
print(f"{table.part}, {table.convention} convention: {len(table.rows)} joints to {table.link}")
print(f"JSON of {len(facts.model_dump_json())} bytes, URDF of {len(to_urdf(robot))}")
