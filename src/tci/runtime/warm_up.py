"""Keeps the machine code that handles a command in the processor's caches while no command is given."""

from __future__ import annotations

import numpy as np

from tci.body.generic_body import GenericBody
from tci.gate.gate import Gate
from tci.gate.spare_motion import SpareMotion
from tci.messages import GenericCommand, JointReading, Mode
from tci.robot.joint_map import initial_position

WARM_UP = 16
"""Number of periods after which the warm-up is repeated. Measured: the first command after 200 periods
without commands then takes as long as a command in a series of commands. With 64 instead of 16 periods, the
first command takes longer."""


class WarmUp:
    """Converts a command and plans its motion as a control loop does, but for no robot.

    Touches are rare. Between two touches, other code replaces the code of a command in the processor's
    caches, so the first command would take 30 us longer than later commands. A step takes 20 us; call `step`
    in the spare time of a period.
    """

    def __init__(self, body: GenericBody, gate: Gate) -> None:
        """Prepares a command to the first part of the robot, with the period and the speed limits of
        `gate`. The state of the gate is neither read nor changed."""
        robot = body.robot
        self._body = body
        self._commands = [
            GenericCommand(part.name, Mode.POSITION, part.initial_posture) for part in robot.parts[:1]
        ]
        position = np.array(initial_position(robot))
        self._joints = JointReading(0.0, 0, position, np.zeros(len(position)))
        self._motion = SpareMotion(robot, period=gate.period, speed_share=gate.settings.speed_share)

    def step(self) -> None:
        """Converts the command that the constructor prepared, and takes one step of its motion."""
        self._body.to_platform(self._commands, self._joints)
        self._motion.step()
