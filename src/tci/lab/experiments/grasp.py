"""Trial of a light grasp in simulation.

A ball moves to the palm of a hand, the hand grasps the ball, and the ball is pulled out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tci.capabilities.light_grasp import LightGrasp
from tci.drivers.simulated import SimulatedDriver
from tci.robot.description import Robot
from tci.robot.generic_fingers import FINGERS, FLEXIONS
from tci.runtime.loop import Tick, run
from tci.simulation.held_ball import held_ball
from tci.simulation.world import World

SETTLES, HOLDS, ENDS = 1.7, 2.0, 2.9
"""Times [s] in a trial: SETTLES is the beginning of the force measurement, HOLDS the beginning of the pull,
and ENDS the end of the trial. Assumed: these times are long enough, because the fingers start close to the
ball."""
PULL = 0.05
"""Speed [m/s] with which the ball is pulled out of the palm. Assumed: a person pulls gently with this
speed."""
OPEN = np.deg2rad(5.0)
"""The hand counts as opened if the sum of all fingers' flexions has decreased by at least this angle
[rad]."""


@dataclass(frozen=True, slots=True)
class Grasp:
    """Result of a grasp trial with one hand."""

    radius: float
    """Radius [m] of the ball."""
    meant: tuple[str, ...]
    """Fingers that should touch the ball according to the kinematics of the hand."""
    forces: Mapping[str, float]
    """Mean force [N] that the skin of each finger measures while the hand grasps the ball, by finger. Fingers
    without force are not included."""
    peak: float
    """Largest force [N] on a finger before the ball is pulled out of the hand."""
    opened: bool
    """True if the hand opened when the ball was pulled."""
    refused: tuple[str, ...]
    """Reasons for which the gate refused a command or held the robot."""


def try_grasp(robot: Robot, part: str, capability: LightGrasp | None = None) -> Grasp:
    """Simulates a light grasp with the hand `part`. The size of the ball fits this hand.

    Raises TciError if no ball fits the hand.
    """
    grasp = LightGrasp() if capability is None else capability
    ball = held_ball(robot, part, opposition=grasp.opposition)
    skin = [patch.name for patch in robot.patches if patch.part == part]
    world = World(robot, skin=skin, tip=ball.radius, posture={part: ball.posture})
    world.finger.poke(ball.patch, ball.taxel, depth=0.004, speed=0.1)
    forces: list[list[float]] = []
    bends: list[tuple[float, float]] = []
    refused: dict[str, None] = {}
    step = 1.0 / robot.binding("sim").rate

    def see(tick: Tick) -> None:
        felt = dict.fromkeys(FINGERS, 0.0)
        for contact in tick.perception.contacts:
            if contact.part == part and contact.segment in felt:
                felt[contact.segment] += contact.force
        forces.append([*felt.values()])
        bends.append((tick.now, float(tick.perception.posture[part][list(FLEXIONS)].sum())))
        refused.update(dict.fromkeys(str(reason) for reason in tick.sent.refusals))
        if tick.sent.reason is not None:
            refused[str(tick.sent.reason)] = None
        if tick.now >= HOLDS:
            world.finger.pull(PULL * step)

    run(SimulatedDriver(robot, world=world), grasp, duration=ENDS, observe=see)
    times, bend = np.array(bends).T
    felt = np.array(forces)
    held = felt[(times >= SETTLES) & (times < HOLDS)].mean(axis=0)
    before = times < HOLDS
    return Grasp(
        radius=ball.radius,
        meant=ball.fingers,
        forces={name: float(force) for name, force in zip(FINGERS, held, strict=True) if force > 0.0},
        peak=float(felt[before].max()),
        opened=bool(bend[-1] < bend[before][-1] - OPEN),
        refused=tuple(refused),
    )
