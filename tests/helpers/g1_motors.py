"""A G1 as its owners have it: rigid bodies whose motors do what the vendor says of rt/arm_sdk, so weak that
an arm sags under its own weight. A process of its own, in real time, on DDS.

torque = tau + kp (q - q_now) + kd (dq - dq_now) of the client, and that of the robot's own controller,
mixed by the client's weight.
"""

from __future__ import annotations

import time
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any, Self

import numpy as np

from helpers.rigid_robot import Dirt, RigidRobot
from tci.robot.catalogue import load_robot
from tci.shared.interface_node import MOST, InterfaceNode, latest
from tci.wires.unitree import messages
from tci.wires.unitree.driver import slots_of
from tci.wires.unitree.wire import COMMAND, STATE, WEIGHT, decode_command, encode_state

PERIOD = 0.002
"""Time [s] between two states."""
OWN = 400.0, 10.0
"""Gains of the robot's own controller [N m/rad, N m s/rad], which holds the first posture: stiff."""
ROTOR, FRICTION = 0.01, 0.02
"""Inertia [kg m2] of the vendor's model, and dry friction as a fraction of the torque limit."""


LATE = 0.02
"""Time [s] that the plant may be late; else it goes on from where it is."""


class Motors(RigidRobot):
    """The plant: its actuators take torques."""

    def __init__(self, name: str) -> None:
        self.command: Any = np.zeros((), COMMAND)["motor"]
        self.weight = 0.0
        super().__init__(load_robot(name), dirt=Dirt(friction=FRICTION), compensated=False)
        self.model.dof_armature[self._dof] = ROTOR
        self._first_posture, self._slots = self.position, slots_of(self.robot)

    def _gain(self) -> None:
        self.model.actuator_gainprm[self._motor, 0] = 1.0
        self.model.actuator_biasprm[self._motor] = 0.0

    def _drive(self) -> None:
        position, velocity, motor = self.position, self.velocity, self.command
        own = OWN[0] * (self._first_posture - position) - OWN[1] * velocity
        arms = np.flatnonzero((self._slots >= 12) & (motor["mode"][self._slots] == 1))
        slots, now = self._slots[arms], {name: motor[name][self._slots[arms]] for name in ("tau", "kp", "kd")}
        asked = now["tau"] + now["kp"] * (motor["q"][slots] - position[arms])
        asked += now["kd"] * (motor["dq"][slots] - velocity[arms])
        own[arms] = self.weight * asked + (1.0 - self.weight) * own[arms]
        self.data.ctrl[self._motor] = own[self._servo] / self._ratio


def _live(name: str, domain: int, talk: Connection) -> None:
    plant, node = Motors(name), InterfaceNode("lo", domain)
    state: Any = np.zeros((), STATE)
    state["mode_machine"], state["quaternion"][0], state["accelerometer"][2] = 5, 1.0, 9.81
    states = node.out("rt/lowstate", messages.STATE)
    commands = node.reader("rt/arm_sdk", messages.COMMAND, keep=MOST, reliable=True)
    slots, begun = plant._slots, time.monotonic()
    talk.send("lives")
    while True:
        for sample in latest(commands):
            command, right = decode_command(sample.raw)
            if right:
                plant.command, plant.weight = command["motor"], float(command["motor"]["q"][WEIGHT])
        begun = max(begun, time.monotonic() - plant.time - LATE)
        plant.advance(time.monotonic() - begun)
        motors = state["motor"]
        motors["q"][slots], motors["dq"][slots] = plant.position, plant.velocity
        motors["tau_est"][slots] = plant._of(plant.data.actuator_force[plant._motor])
        state["tick"] = int(plant.time * 1e3)
        states(encode_state(state))
        time.sleep(max(0.0, begun + plant.time + PERIOD - time.monotonic()))


class G1:
    """The process."""

    def __init__(self, domain: int, name: str = "g1") -> None:
        context = get_context("spawn")
        self._talk, theirs = context.Pipe()
        self._process: BaseProcess = context.Process(target=_live, args=(name, domain, theirs), daemon=True)
        self._process.start()
        assert self._talk.poll(60.0), "the robot does not begin"
        self._talk.recv()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._process.kill()
        self._process.join()
