"""Servos of joints with large damping follow their commands as well as other servos."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from helpers.made_humanoid import MadeHumanoid
from tci.lab.authoring.proposal import propose
from tci.simulation.world import World


def test_a_servo_reaches_its_speed_against_the_damping_of_its_joint(tmp_path: Path) -> None:
    """In an earlier version ergoCub's wrist, with 2 N m s/rad and almost no inertia, moved at half its speed
    and the gate stopped the robot."""
    path = MadeHumanoid(legs=False).urdf(tmp_path)
    damped = "<dynamics damping='3' friction='0'/></joint>"
    path.write_text(path.read_text().replace("</joint>", damped).replace("'.01'", "'.0001'"))
    robot = propose(path, name="made")
    wrist = next(servo for servo in robot.servos if servo.name == "left_wrist_pitch")
    world = World(robot, skin=False)
    here = world.joints().position[wrist.index]
    world.set_position_targets([wrist.index], [here + 1.0])
    fastest = 0.0
    for _ in range(150):
        world.advance(world.time + 0.002)
        fastest = max(fastest, float(np.abs(world.joints().velocity[wrist.index])))
    assert wrist.limits.velocity is not None
    assert 0.95 * wrist.limits.velocity < fastest <= 1.01 * wrist.limits.velocity
