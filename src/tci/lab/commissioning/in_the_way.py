"""What a robot does about somebody in its way, as far as its description tells."""

from __future__ import annotations

from tci.drivers.info import SOFTEN
from tci.gate.contact.group import make_groups
from tci.gate.contact.own_weight import OwnWeight
from tci.gate.joint_group import groups_of
from tci.robot.description import Robot


def in_the_way(robot: Robot) -> list[str]:
    """How it notices somebody in its way, and which parts go back, in two sentences."""
    _, groups = make_groups(robot, groups_of(robot), {}, stands=False)
    moved = [part.name for part in robot.parts if any(one.servo is not None for one in part.servos)]
    able = [name for name in moved if groups[name]]
    if not able:
        return ["somebody in the way: no part goes back from whom it meets"]
    felt = ", ".join(dict.fromkeys(patch.part for patch in robot.skin if patch.part in able))
    by_joints = "a joint that stays behind, sooner by joint torques where they are measured (tci doctor)"
    noticed = f"by skin on {felt}, elsewhere by {by_joints}" if felt else f"by {by_joints}"
    wires = " and ".join(
        [
            "in simulation",
            *(f"over {one.middleware}" for one in robot.all_bindings if one.middleware == SOFTEN),
        ]
    )
    waist = any(part.kind == "torso" and part.name in able for part in robot.parts)
    how = f"softly {wires}, else{' and a waist' * waist} stiffly"
    if not OwnWeight(robot).known:
        how = "stiffly, since nobody knows without masses how soft a servo may be that holds its weight"
    others = [name for name in moved if name not in able]
    never = f"; {', '.join(others)} never" if others else ""
    return [
        f"somebody in the way is noticed {noticed}",
        f"{', '.join(able)} go back from whom they meet, {how}{never}",
    ]
