"""Hostile commands in one mode to the robot of rigid bodies (`rigid_robot`), and a judge of its true motion.

The judge knows the true angles, speeds and energy, and the limits of the description. It takes nothing from
`tci.gate` (a test holds that), so it shares no assumption about masses with it.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from helpers.rigid_robot import Dirt, RigidDriver, RigidRobot
from tci.errors import CommandError
from tci.messages import JointReading, Mode, PlatformCommand, PlatformOrder, PlatformSwitch
from tci.messages.frames import Array, read_only
from tci.robot.clearance import Clearance
from tci.robot.description import Limits, Robot
from tci.robot.joint_map import initial_position

MORE, LOOSE, LONG = 1.05, 1.3, 0.02
"""Share of a limit that a true motion may reach; in torque mode the share for at most `LONG` [s]."""
GROWS, FLOOR = 1.10, 0.01
"""Growth of kinetic energy minus gravity's work that is permitted without readings, and the share of the
energy at the speed limits below which it counts as rest."""
SILENCE = 0.25
"""Length of a silence [s]."""
COASTS = 0.5
"""Time [s] after a silence in which links may touch: without readings nothing brakes in torque mode."""


@dataclass
class Judged:
    """What was seen so far; shares are multiples of what is permitted without `MORE`."""

    cycles: int = 0
    silences: int = 0
    speed: float = 0.0
    longest: float = 0.0
    """Longest time [s] for which one joint was above `MORE` of its speed limit."""
    beyond: float = 0.0
    """Deepest angle outside the limits, as a share of the joint's range."""
    energy: float = 0.0
    growth: float = 0.0
    overlap: float = 0.0
    """[m]."""
    stops: list[str] = field(default_factory=list)
    worst: str = ""

    def faults(self, mode: Mode) -> list[str]:
        """What is not within the promise."""
        loose = mode is Mode.TORQUE
        found = (
            ("speed", self.speed, LOOSE if loose else MORE),
            ("time above the limit", self.longest, LONG if loose else 0.0),
            ("outside", self.beyond, MORE - 1.0),
            ("energy", self.energy, MORE),
            ("growth without readings", self.growth, GROWS),
            ("overlap", self.overlap, 0.0),
        )
        bad = [f"{what} {value:.3g}; valid: at most {most:g} ({self.worst})" for what, value, most in found
               if value > most]  # fmt: skip
        return bad + self.stops


class FourModes:
    """One robot, one mode, one seed."""

    def __init__(
        self, robot: Robot, mode: Mode, seed: int, *, rate: float | None = None, dirt: Dirt | None = None,
        bodies: bool = True,
    ) -> None:  # fmt: skip
        self.robot, self.mode = robot.model_copy(update={"patches": ()}), mode
        self.random = np.random.default_rng([seed, 7])
        limits = [servo.limits for servo in robot.servos]
        able = [s.index for s in robot.servos if mode in s.modes and s.limits.acceleration and s.joints]
        if mode is Mode.TORQUE:
            able = [s for s in able if limits[s].torque]
        self.able: NDArray[np.intp] = np.array(able, dtype=np.intp)
        self.lower = np.array([-np.inf if x.lower is None else x.lower for x in limits])
        self.upper = np.array([np.inf if x.upper is None else x.upper for x in limits])
        self.fastest = np.array([x.velocity or np.inf for x in limits])
        self.strongest = np.array([x.torque or np.inf for x in limits])
        self.plant = RigidRobot(
            self.robot,
            seed=seed,
            dirt=dirt,
            rate=rate,
            angles=np.clip(initial_position(robot), *_ends(robot)),
        )
        self.driver = RigidDriver(self.plant)
        self.period = self.driver.period
        self.seen = Judged()
        self._clearance = Clearance(self.robot) if bodies else None
        self._over = np.zeros(len(limits))
        self._silent: JointReading | None = None
        self._until = self.random.uniform(0.5, 1.5)
        self._before: float | None = None
        self._lost = 0.0
        self._wanted, self._again = np.zeros(len(able)), np.zeros(len(able))
        self._usual = 0.0
        self._latest = -1
        self._coasts = 0.0

    def step(self) -> Any:
        """One period."""
        now = self.plant.time
        orders = self._orders(now)
        joints = self.driver.read().joints
        if joints.sequence > self._latest:
            self._latest = joints.sequence
        if self._silent is None and self.random.random() < self.period / 2.0:
            self._silent, self._until = joints, now + SILENCE
            self.seen.silences += 1
            self._before, self._lost = None, 0.0
            # nobody can know of the silence before the next reading is due, and orders are on their way
            self._due = joints.stamp + self._age() + self.period
        elif self._silent is not None and now > self._until:
            self._silent = None
        if self._silent is not None:
            joints = self._silent
        safe = self.driver.gate.step(orders, joints, now)
        self.driver.write(safe)
        if safe.state.name == "STOP":
            self.seen.stops.append(str(safe.reason))
            self.plant._orders.clear()
            self._restart()
        work = self._advance(now + self.period)
        self._judge(safe, now, work)
        self.seen.cycles += 1
        return safe

    def _age(self) -> float:
        """Usual age [s] of a reading when the next one comes, and the time until an order takes effect."""
        return self.plant._delay * 1.33 + 1.0 / self.plant._rate + self.plant._lateness + self.period

    def _restart(self) -> None:
        """As an operator: waits until the robot rests, then resets the gate."""
        for _ in range(int(1.0 / self.period)):
            self.driver.gate.step((), self.driver.read().joints, self.plant.time)
            self.plant.advance(self.plant.time + self.period)
            with suppress(CommandError):
                self.driver.gate.reset()
                break
        self._silent = None
        self._over[:] = 0.0

    def _advance(self, until: float) -> float:
        """Runs the physics; the work [J] that gravity did."""
        plant = self.plant
        before = plant.data.qpos.copy()
        plant.advance(until)
        data, model = plant.data, plant.model
        return _gravity_work(model, data, before)

    def _orders(self, now: float) -> list[PlatformOrder]:
        gate, random = self.driver.gate, self.random
        orders: list[PlatformOrder] = []
        if any(gate.modes[servo] is not self.mode for servo in self.able):
            orders.append(PlatformSwitch(self.able, self.mode))
        fresh = self._again <= now
        if fresh.any():
            self._again[fresh] = now + random.uniform(0.02, 1.0, fresh.sum())
            self._wanted[fresh] = self._draw()[fresh]
        elif self.mode in (Mode.POSITION, Mode.IMPEDANCE):
            return orders
        orders.append(
            PlatformCommand(self.mode, self.able, self._wanted.copy(), np.full(len(self.able), np.inf))
        )
        return orders

    def _draw(self) -> Array:
        random, own = self.random, self.able
        if self.mode in (Mode.POSITION, Mode.IMPEDANCE):
            low, high = self.lower[own], self.upper[own]
            return random.uniform(low - 0.1, high + 0.1)
        most = self.fastest[own] if self.mode is Mode.VELOCITY else self.strongest[own]
        kind = random.integers(3, size=len(own))
        share = np.where(kind == 0, random.uniform(-1.0, 1.0, len(own)), random.choice([-1.0, 1.0], len(own)))
        return most * np.where(kind == 2, 0.0 * share + random.choice([-1.0, 1.0]), share)

    def _judge(self, safe: Any, now: float, work: float) -> None:
        seen, plant = self.seen, self.plant
        own = self.able
        share = np.abs(plant.velocity[own]) / self.fastest[own]
        k = int(np.argmax(share))
        if share[k] > seen.speed:
            seen.speed, seen.worst = float(share[k]), f"{self.robot.servos[own[k]].name} at {now:.2f} s"
        self._over[own] = np.where(share > MORE, self._over[own] + self.period, 0.0)
        seen.longest = max(seen.longest, float(self._over.max()))
        angle = plant.position
        outside = np.maximum(angle - self.upper, self.lower - angle)[own]
        seen.beyond = max(seen.beyond, float((outside / (self.upper - self.lower)[own]).max()))
        full = np.zeros((plant.model.nv, plant.model.nv))
        mujoco.mj_fullM(plant.model, plant.data, full)
        dof = plant._dof
        most = self.fastest[plant._servo]
        most = np.where(np.isfinite(most), most, 0.0)
        square = full[np.ix_(dof, dof)]
        limit = 0.5 * float(most @ np.abs(square) @ most)
        speeds = plant.data.qvel[dof]
        energy = 0.5 * float(speeds @ square @ speeds)
        seen.energy = max(seen.energy, energy / limit)
        if self._silent is not None:
            self._lost += work
            if now >= self._due:
                own_energy = energy - self._lost
                if self._before is None:
                    self._before = own_energy
                floor = FLOOR * limit
                seen.growth = max(seen.growth, (own_energy + floor) / (max(self._before, 0.0) + floor))
        self._coasts = now + COASTS if self._silent is not None else self._coasts
        if self._clearance is not None and seen.cycles % 4 == 0 and now > self._coasts:
            gap = self._clearance.gap(angle, within=0.02)
            seen.overlap = max(seen.overlap, -gap.distance)


def pushed(
    robot: Robot, servo: int, *, held: bool, rate: float = 200.0, delay: float = 0.012, seed: int = 0,
    lasts: float = 1.5,
) -> tuple[float, float]:  # fmt: skip
    """Asks one joint for its full torque, and says how fast it became, as a share of its limit, and which
    share of its torque it gets at the end. A joint is `held` by something stiff (2000 N m/rad)."""
    dirt = Dirt(delay=(delay, delay))
    plant, limits = _placed(robot, servo, 0.5 if held else 0.05, seed=seed, dirt=dirt, rate=rate)
    mine = plant._servo == servo
    if held:
        dof, qpos = plant._dof[mine], plant._qpos[mine]
        plant.model.jnt_stiffness[plant.model.dof_jntid[dof]] = 2000.0
        plant.model.qpos_spring[qpos] = plant.data.qpos[qpos]
        plant.model.dof_damping[dof] = 20.0
    driver, index, fastest, sent = RigidDriver(plant), np.array([servo]), 0.0, 0.0
    orders: list[PlatformOrder] = [PlatformSwitch(index, Mode.TORQUE)]
    while plant.time < lasts:
        orders.append(PlatformCommand(Mode.TORQUE, index, np.array([limits.torque]), np.ones(1)))
        safe = driver.write(driver.gate.step(orders, driver.read().joints, plant.time))
        plant.advance(plant.time + driver.period)
        orders = []
        sent = float(safe.torque[safe.servos == servo].sum())
        fastest = max(fastest, float(plant.velocity[servo]))
    return fastest / (limits.velocity or np.nan), sent / limits.torque


def frozen(
    robot: Robot, servo: int, *, share: float, friction: float, rate: float = 500.0, seed: int = 1
) -> tuple[float, float, str]:
    """Asks one joint for a `share` of its torque while its encoder is frozen, and says how fast the joint
    became before the robot stopped, as a share of its limit, how far it turned [rad], and why it stopped."""
    dirt = Dirt(friction=friction, motor=(0.3, 0.3) if friction == 0.0 else (0.0, 1.0))
    plant, limits = _placed(robot, servo, 0.1, seed=seed, dirt=dirt, rate=rate)
    driver, index, fastest = RigidDriver(plant), np.array([servo]), 0.0
    driver.write(driver.gate.step(PlatformSwitch(index, Mode.TORQUE), driver.read().joints, plant.time))
    order = PlatformCommand(Mode.TORQUE, index, np.array([share * (limits.torque or 0.0)]), np.ones(1))
    start = plant.position[servo]
    angle = driver.read().joints.position[servo]
    while plant.time < 1.5:
        plant.advance(plant.time + driver.period)
        joints = driver.read().joints
        position, velocity = joints.position.copy(), joints.velocity.copy()
        position[servo], velocity[servo] = angle, 0.0
        joints = replace(joints, position=read_only(position), velocity=read_only(velocity))
        safe = driver.write(driver.gate.step(order, joints, plant.time))
        fastest = max(fastest, abs(float(plant.velocity[servo])))
        if safe.reason is not None:
            break
    return fastest / (limits.velocity or np.nan), abs(plant.position[servo] - start), str(safe.reason)


def _placed(
    robot: Robot, servo: int, where: float, *, seed: int, dirt: Dirt, rate: float
) -> tuple[RigidRobot, Limits]:
    """The plant with one joint at the share `where` of its range."""
    robot = robot.model_copy(update={"patches": ()})
    limits = robot.servos[servo].limits
    assert limits.lower is not None
    assert limits.upper is not None
    assert limits.torque
    start = np.clip(initial_position(robot), *_ends(robot))
    start[servo] = limits.lower + where * (limits.upper - limits.lower)
    return RigidRobot(robot, seed=seed, dirt=dirt, rate=rate, angles=start), limits


def _ends(robot: Robot) -> tuple[Array, Array]:
    limits = [servo.limits for servo in robot.servos]
    lower = np.array([-np.inf if x.lower is None else x.lower for x in limits])
    upper = np.array([np.inf if x.upper is None else x.upper for x in limits])
    return lower + 1e-3, upper - 1e-3


def _gravity_work(model: Any, data: Any, before: Array) -> float:
    """Work [J] of gravity that is not compensated, over the last period."""
    step = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, step, 1.0, before, data.qpos)
    held = data.qfrc_bias - data.qfrc_gravcomp
    return -float(held @ step)
