"""Motions at full speed of a robot of rigid bodies (`rigid_robot`) with which nothing is wrong but what is
usual: coarse, late and doubled readings, other masses, dry friction, and something in its hands.

Whatever stops it, or is called a contact, is a false alarm. Nothing of `tci.gate` is imported (a test holds
that).
"""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from helpers.rigid_robot import Dirt, RigidDriver, RigidRobot
from tci.errors import CommandError
from tci.messages import Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.description import Robot
from tci.robot.kinematics import KinematicChain

UNDECLARED, DECLARED = 0.3, 0.5
"""Masses [kg] in the right hand, of which nobody is told, and in the left hand, which the gate is told."""


class Healthy:
    """One robot, one mode, one seed."""

    def __init__(
        self,
        robot: Robot,
        mode: Mode,
        seed: int,
        *,
        rate: float,
        dirt: Dirt | None = None,
        settings: Any = None,
    ) -> None:
        self.robot, self.mode = robot.model_copy(update={"patches": ()}), mode
        self.random = np.random.default_rng([seed, 43])
        able = [s.index for s in robot.servos if mode in s.modes and s.limits.acceleration and s.joints]
        limits = [robot.servos[servo].limits for servo in able]
        if mode is Mode.TORQUE:
            able = [servo for servo, one in zip(able, limits, strict=True) if one.torque]
            limits = [robot.servos[servo].limits for servo in able]
        self.able: NDArray[np.intp] = np.array(able, dtype=np.intp)
        self._low = np.array([x.lower for x in limits], dtype=float)
        self._high = np.array([x.upper for x in limits], dtype=float)
        self._fastest = np.array([x.velocity for x in limits], dtype=float)
        self._strongest = np.array([x.torque or 0.0 for x in limits])
        self.plant = RigidRobot(self.robot, dirt=dirt, seed=seed, rate=rate)
        self.driver = RigidDriver(self.plant, settings=settings)
        self.alarms: Counter[str] = Counter()
        """What was told though nothing is wrong, with how often."""
        self.moved = 0.0
        """Way [rad] of all joints together."""
        self._carry()
        self._wanted, self._until = np.zeros(len(able)), 0.0
        self._told = ""

    def _carry(self) -> None:
        chain, model = KinematicChain(self.robot), self.plant.model
        for part in self.robot.parts:
            if part.kind != "arm":
                continue
            own = {one.servo for one in part.servos}
            last = max(chain.links, key=lambda name: len(own & {*chain.chain(name)}))
            body, mass = model.body(last).id, DECLARED if part.side == "left" else UNDECLARED
            before = model.body_mass[body]
            model.body_mass[body] += mass
            model.body_gravcomp[body] *= before / model.body_mass[body]
            if part.side == "left":
                self.driver.gate.load(part.name, mass)
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def run(self, lasts: float) -> None:
        """Moves for `lasts` [s]."""
        gate, plant, before = self.driver.gate, self.plant, self.plant.position
        end = plant.time + lasts
        while plant.time < end:
            safe = gate.step(self._orders(plant.time), self.driver.read().joints, plant.time)
            self.driver.write(safe)
            if safe.reason is not None:
                self._alarm(f"{safe.state.value}: {safe.reason}")
                with suppress(CommandError):
                    gate.reset()
            else:
                told = [one.text for one in (*safe.clamped, *safe.refusals) if one.code is Code.CONTACT]
                met = [f"{one.part} by {one.joint}, {one.behind:.3f} rad" for one in safe.met]
                self._alarm(*met, *told)
            plant.advance(plant.time + self.driver.period)
            after = plant.position
            self.moved += float(np.abs(after - before).sum())
            before = after

    def _alarm(self, *words: str) -> None:
        """Notes an alarm when it begins."""
        told = words[0] if words else ""
        if told and not self._told:
            self.alarms[told] += 1
        self._told = told

    def _orders(self, now: float) -> list[PlatformOrder]:
        random, orders = self.random, list[PlatformOrder]()
        if any(self.driver.gate.modes[servo] is not self.mode for servo in self.able):
            orders.append(PlatformSwitch(self.able, self.mode))
        fresh = now >= self._until
        if fresh:
            self._until = now + random.uniform(0.2, 1.5)
            self._wanted = self._draw()
        if fresh or self.mode in (Mode.VELOCITY, Mode.TORQUE):
            speed = np.full(len(self.able), np.inf)
            orders.append(PlatformCommand(self.mode, self.able, self._wanted, speed))
        return orders

    def _draw(self) -> Array:
        """Half of the joints rest, or all."""
        random, count = self.random, len(self.able)
        moves = (random.random(count) < 0.5) & (random.random() < 0.8)
        if self.mode in (Mode.POSITION, Mode.IMPEDANCE):
            here = self.plant.position[self.able]
            kept = self._wanted if self._wanted.any() else here
            return np.where(moves, random.uniform(self._low, self._high), kept)
        most = self._fastest if self.mode is Mode.VELOCITY else 0.5 * self._strongest
        return np.where(moves, most * random.uniform(-1.0, 1.0, count), 0.0)
