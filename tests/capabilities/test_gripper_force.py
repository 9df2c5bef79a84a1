"""A gripper holds a ball at the force that it is told, and lets go of it: judged by contact forces of MuJoCo,
not by the skin."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np

import tci
from tci.capabilities import LightGrasp
from tci.drivers.simulated import SimulatedDriver
from tci.lab.authoring.proposal import propose
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.xml import read_robot
from tci.robot.xml.writer import write_robot
from tci.runtime.loop import Tick
from tci.simulation.held_ball import held_ball
from tci.simulation.world import World

HELD, ENDS = 2.2, 3.2
PULLS = 0.05
"""Speed [m/s] with which the ball is pulled out from `HELD` on."""
STIFF = """<mujoco><compiler angle="radian"/><worldbody>
<body name="base"><geom type="box" size="0.035 0.08 0.02" mass="0.6"/>
  <body name="left" pos="0 0.028 0.02"><joint name="l" axis="-1 0 0" range="-0.3 0.6"/>
    <geom type="box" size="0.01 0.005 0.05" pos="0 0.005 0.05" mass="0.17"/></body>
  <body name="right" pos="0 -0.028 0.02"><joint name="r" axis="1 0 0" range="-0.3 0.6"/>
    <geom type="box" size="0.01 0.005 0.05" pos="0 -0.005 0.05" mass="0.17"/></body>
</body></worldbody><actuator>
  <position joint="l" kp="1000" forcelimited="true" forcerange="-20 20"/>
  <position joint="r" kp="1000" forcelimited="true" forcerange="-20 20"/></actuator></mujoco>"""
"""Two jaws that swing, of 0.1 m and 20 N m each, as a PR2's: 200 N at the tip."""


def felt(robot: Robot, part: str, jaws: list[str], grasp: LightGrasp) -> tuple[Array, Array]:
    """Times (t,) [s], and the forces (jaws, t) [N] with which they press a ball that is pulled out from
    `HELD` on."""
    ball = held_ball(robot, part)
    skin = [patch.name for patch in robot.patches if patch.part == part]
    world = World(robot, skin=skin, tip=ball.radius, posture={part: ball.posture})
    world.finger.poke(ball.patch, ball.taxel, depth=0.004, speed=0.1)
    model, data, rows = world.model, world.data, list[list[float]]()

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

    tci.run(SimulatedDriver(robot, world=world), grasp, duration=ENDS, observe=see)
    time, *forces = np.array(rows).T
    return time, np.array(forces)


def test_two_sliding_jaws_hold_with_three_newtons_and_let_go_on_a_pull() -> None:
    time, forces = felt(
        tci.load_robot("franka-hand"), "left_fingers", ["panda_leftfinger", "panda_rightfinger"],
        LightGrasp(force=3.0, pull=7.5),
    )  # fmt: skip
    held = forces[:, (time > HELD - 0.3) & (time < HELD)]
    assert np.abs(held - 3.0).max() < 0.3
    assert np.max(forces) < 7.5
    assert (forces[:, -50:] == 0.0).all()


def test_stiff_jaws_arrive_softly_hold_with_one_newton_and_are_open_half_a_second_after_a_pull(
    tmp_path: Path,
) -> None:
    (tmp_path / "jaws.xml").write_text(STIFF)
    target = tmp_path / "robot.xml"
    proposed = propose(tmp_path / "jaws.xml", name="jaws", side="right")
    target.write_text(write_robot(proposed, file="jaws.xml"))
    time, forces = felt(read_robot(target), "right_fingers", ["left", "right"], LightGrasp())
    assert forces[:, time < HELD].max() < 8.0
    assert np.abs(forces[:, (time > HELD - 0.3) & (time < HELD)] - 1.0).max() < 0.1
    assert forces[:, time > HELD].max() < 5.0
    assert (forces[:, time > HELD + 0.5] == 0.0).all()
