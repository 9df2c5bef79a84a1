"""Trials of `squeezed` in real time, through a genuine wire: a process of its own serves the plant."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

import tci
from helpers.rigid_robot import RigidClock, RigidDriver, RigidRobot
from helpers.squeezed import SWAYS, Pressed, Squeeze, Sway, moved_by, plant_of, pressed
from tci.drivers.registry import load_server
from tci.gate.settings import GateSettings
from tci.runtime.serve import serve

PATIENCE = 60.0
"""Longest time [s] until the robot is served."""
LASTS = 5.0
"""Time [s] from the order to the end."""
LATE = 0.05
"""Time [s] that the plant may be late; else it goes on from where it is, as a robot whose bus stood still."""


class PacedClock(RigidClock):
    """The plant's time, no faster than real time."""

    def __init__(self, plant: RigidRobot) -> None:
        super().__init__(plant)
        self._ahead = time.monotonic() - plant.time

    def sleep_until(self, stamp: float) -> None:
        super().sleep_until(stamp)
        late = time.monotonic() - (self.now() + self._ahead)
        if late > LATE:
            self._ahead += late
        time.sleep(max(-late, 0.0))


class _End(Exception):
    pass


def _serve(name: str, one: Squeeze, via: str, talk: Connection, answers: bool) -> None:
    """Serves the plant. Puts the person in the way when it is told, and says at the end what they bore."""
    plant = plant_of(tci.load_robot(name), one)
    driver = RigidDriver(plant, settings=None if answers else GateSettings(contact=None))
    driver.info = replace(driver.info, clock=PacedClock(plant))
    person, felt, served = plant.felt["person"], False, False

    def see(_: Any) -> None:
        nonlocal felt, served
        if not served:
            served = True
            talk.send("serves")
        felt = felt or (person.now > 1.0 and plant.on_skin("person"))
        if talk.poll():
            if talk.recv() == "end":
                raise _End
            plant.place("person", one.at)

    wire, _, address = via.partition(":")
    server = load_server(wire)(driver, address)
    with suppress(_End):
        serve(server, observe=see)
    talk.send(pressed(person, felt))
    server.close()


def squeeze_over(via: str, name: str, one: Squeeze, *, answers: bool) -> tuple[Pressed, tci.RunResult[Any]]:
    """Runs a trial by `order` or `gesture` over `via`: the arm sways, then meets somebody. The process that
    serves it `answers` contact, as `tci serve` does; a robot's own programs do not. Returns what they bore,
    and the result of the run in which they were met."""
    context = get_context("spawn")
    talk, theirs = context.Pipe()
    robot = context.Process(target=_serve, args=(name, one, via, theirs, answers), daemon=True)
    robot.start()
    try:
        assert talk.poll(PATIENCE), "the robot is not served"
        talk.recv()
        with tci.connect(name, via, arm=True) as driver:
            tci.run(driver, Sway(one), duration=SWAYS)
            talk.send("somebody comes")
            result = tci.run(driver, moved_by(one), duration=LASTS)
        talk.send("end")
        assert talk.poll(PATIENCE), "the robot died"
        return talk.recv(), result
    finally:
        robot.kill()
        robot.join()
