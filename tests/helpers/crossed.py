"""A simulated robot whose driver is wrong, and a simulated operator who observes the robot's true motion."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.gate.gate import SafeCommand
from tci.lab.commissioning.expected_motion import ExpectedMotion
from tci.messages import Reading
from tci.messages.frames import read_only
from tci.robot.description import Robot
from tci.robot.joint_map import generic_posture
from tci.robot.kinematics import KinematicChain
from tci.simulation.world import World


class Crossed(SimulatedDriver):
    """A simulated robot whose driver is wrong. Angle i of the driver is `scale[i]` times angle `order[i]` of
    the robot. This applies to commands and, unless the encoders are correct, to encoder readings."""

    def __init__(
        self, robot: Robot, *, scale: dict[str, float] | None = None, swap: tuple[str, str] | None = None,
        sound_encoders: bool = False, **options: Any,
    ) -> None:  # fmt: skip
        super().__init__(robot, **options)
        index = {servo.name: servo.index for servo in robot.servos}
        self.scale = np.ones(len(index))
        for name, value in (scale or {}).items():
            self.scale[index[name]] = value
        self.order = np.arange(len(index))
        if swap is not None:
            a, b = (index[name] for name in swap)
            self.order[[a, b]] = b, a
        self._sound = sound_encoders
        self.start = np.array(self.world.joints().position)
        self.far = np.zeros(len(index))
        """Largest true displacement (n,) [rad] of each servo since the start."""
        self.now = np.zeros(len(index))
        """Largest true displacement (n,) [rad] of each servo since the last call of `look`, with its sign."""
        self.base = self.start

    def _receive(self) -> Reading:
        reading = super()._receive()
        true = reading.joints.position
        self.far = np.maximum(self.far, np.abs(true - self.start))
        moved = true - self.base
        self.now = np.where(np.abs(moved) > np.abs(self.now), moved, self.now)
        if self._sound:
            return reading
        told = read_only(self.scale * true[self.order])
        return replace(reading, joints=replace(reading.joints, position=told))

    def look(self) -> None:
        """Starts a new measurement of `now` at the present posture."""
        self.base = np.array(self.world.joints().position)
        self.now = np.zeros_like(self.base)

    def _send(self, safe: SafeCommand) -> None:
        servos = read_only(self.order[safe.servos], np.intp)
        position = read_only(safe.position / self.scale[safe.servos])
        shares = MappingProxyType({int(self.order[s]): v for s, v in safe.stiffness.items()})
        super()._send(replace(safe, servos=servos, position=position, stiffness=shares))


class Witness:
    """A simulated operator who answers questions according to the true motion of `driver`. `claimed` is the
    driver whose description is tested."""

    def __init__(self, driver: Crossed, claimed: Any) -> None:
        self._driver, self._claimed = driver, claimed
        self._kinematics = KinematicChain(driver.robot)
        self.asked: list[str] = []

    def may(self, what: str) -> bool:
        self.asked.append(what)
        self._driver.look()
        return True

    def saw(self, what: str, expected: ExpectedMotion | None) -> bool | None:
        if expected is None and what.startswith("It went"):  # a hand without a joint in the model
            return bool(np.abs(self._driver.now).max() > np.deg2rad(1.0))
        if expected is None:
            return self._stands(what.split(" ")[0])
        before, after = self._driver.base, self._driver.base + self._driver.now
        T0 = self._kinematics.poses(before, [expected.link])[expected.link]
        T1 = self._kinematics.poses(after, [expected.link])[expected.link]
        moved = T1[:3, 3] - T0[:3, 3]
        if np.linalg.norm(expected.displacement) > 5e-4:
            return _alike(moved, expected.displacement)
        turned = 0.5 * (T1[:3, :3] @ T0[:3, :3].T - T0[:3, :3] @ T1[:3, :3].T)
        return _alike(np.array([turned[2, 1], turned[0, 2], turned[1, 0]]), expected.rotation)

    def still(self, what: str) -> bool:
        return bool(np.abs(self._driver.now).max() < np.deg2rad(0.5))

    def press(self, patch: str, taxel: int, where: str) -> bool:
        try:
            self._driver.world.finger.poke(patch, taxel, depth=0.004)
        except TciError:
            return False
        return True

    def release(self) -> None:
        self._driver.world.finger.retire()

    def _stands(self, part: str) -> bool:
        true = generic_posture(self._driver.robot, self._driver.world.joints())[part]
        told = generic_posture(self._claimed.robot, self._claimed.read().joints)[part]
        return bool(np.abs(true - told).max() < np.deg2rad(10.0))


def _alike(seen: np.ndarray, expected: np.ndarray) -> bool:
    size = np.linalg.norm(expected)
    return bool(
        seen @ expected > 0.7 * np.linalg.norm(seen) * size and 0.4 < np.linalg.norm(seen) / size < 2.5
    )


def world_of(robot: Robot, **posture: list[float]) -> World:
    """Returns a simulated world in which the generic parts start at these angles [degrees]."""
    return World(robot, posture={part: np.deg2rad(angles) for part, angles in posture.items()})
