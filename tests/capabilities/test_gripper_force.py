"""A gripper holds a ball at the force that it is told, and lets go of it: judged by contact forces of MuJoCo,
not by the skin."""

from __future__ import annotations

import mujoco
import numpy as np

import tci
from tci.capabilities import LightGrasp
from tci.drivers.simulated import SimulatedDriver
from tci.runtime.loop import Tick
from tci.simulation.held_ball import held_ball
from tci.simulation.world import World

HELD, ENDS = 2.2, 3.2
PULLS = 0.05
"""Speed [m/s] with which the ball is pulled out from `HELD` on."""


def test_two_sliding_jaws_hold_with_three_newtons_and_let_go_on_a_pull() -> None:
    robot, part = tci.load_robot("franka-hand"), "left_fingers"
    ball = held_ball(robot, part)
    skin = [patch.name for patch in robot.patches if patch.part == part]
    world = World(robot, skin=skin, tip=ball.radius, posture={part: ball.posture})
    world.finger.poke(ball.patch, ball.taxel, depth=0.004, speed=0.1)
    model, data, rows = world.model, world.data, list[list[float]]()
    jaws = ["panda_leftfinger", "panda_rightfinger"]

    def see(tick: Tick) -> None:
        felt, force = dict.fromkeys(jaws, 0.0), np.zeros(6)
        for number, contact in enumerate(data.contact[: data.ncon]):
            touched = [model.body(int(model.geom_bodyid[geom])).name for geom in contact.geom]
            if "tci_finger_tip" in touched and set(touched) & set(jaws):
                mujoco.mj_contactForce(model, data, number, force)
                felt[next(name for name in touched if name in felt)] += force[0]
        rows.append([tick.now, *felt.values()])
        if tick.now >= HELD:
            world.finger.pull(PULLS * world.step)

    grasp = LightGrasp(force=3.0, pull=7.5)
    tci.run(SimulatedDriver(robot, world=world), grasp, duration=ENDS, observe=see)
    time, *forces = np.array(rows).T
    held = np.array(forces)[:, (time > HELD - 0.3) & (time < HELD)]
    assert np.abs(held - 3.0).max() < 0.3
    assert np.max(forces) < 7.5
    assert (np.array(forces)[:, -50:] == 0.0).all()
