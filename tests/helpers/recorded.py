"""Recordings for tests: of a simulated run, and of artificial skins of any size."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.cli.session import poke_skin
from tci.drivers.simulated import SimulatedDriver
from tci.messages import JointReading, Mode, Reading, SkinFrame
from tci.recording.recorder import Recorder
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run


def record_poke(
    path: Path,
    *,
    robot: str = "nao",
    duration: float = 0.6,
    keep_alive: float | None = None,
    rate: float | None = None,
) -> list[Tick]:
    """Records the reflex of a poked robot, and returns the readings of the loop.

    With `keep_alive` [s], the skin sends frames only on change, and at least once in this time.
    """
    ticks: list[Tick] = []
    with (
        SimulatedDriver(load_robot(robot), keep_alive=keep_alive, rate=rate) as driver,
        Recorder(path, driver.robot, period=driver.period, keep_alive=keep_alive) as recorder,
    ):
        poke_skin(driver)

        def see(tick: Tick) -> None:
            ticks.append(tick)
            recorder.tick(tick.now, tick.reading, tick.commands, tick.sent, tick.perception)

        run(driver, WithdrawalReflex(), duration=duration, observe=see)
    return ticks


LIKE_LISTING_2 = """<generic_robot angle_unit="deg">
  <generic_robot_part name="one">
    <generic_servo id="0"><destination_servo_id>0</destination_servo_id></generic_servo>
  </generic_robot_part>
  <generic_robot_part name="two">
    <generic_servo id="0"><destination_servo_id>0</destination_servo_id></generic_servo>
    <generic_servo id="1"><destination_servo_id>1</destination_servo_id></generic_servo>
  </generic_robot_part>
</generic_robot>
"""


def two_parts(folder: Path) -> Robot:
    """Returns a robot as in Listing 2 of the paper, without a model. Its servos are named servo0, servo0 and
    servo1."""
    path = folder / "two.xml"
    path.write_text(LIKE_LISTING_2)
    return load_robot(str(path))


def made_up(count: int, *, taxels: int = 768, servos: int = 12) -> list[tuple[float, Reading]]:
    """Yields readings at 100 Hz: 8-bit skin with a moving touch and some noise, and joints that move back and
    forth."""
    random = np.random.default_rng(1)
    readings = []
    for number in range(count):
        now = number * 0.01
        values = np.full(taxels, 240, dtype=np.uint8)
        touched = (number // 5 + np.arange(20)) % taxels
        values[touched] -= random.integers(20, 90, 20).astype(np.uint8)
        values -= (random.random(taxels) < 0.1).astype(np.uint8)
        joints = JointReading(
            now, number, np.sin(now + np.arange(servos)), np.cos(now + np.arange(servos)),
            torque=None, modes=(Mode.POSITION, None) * (servos // 2), powered=np.ones(servos, dtype=bool),
        )  # fmt: skip
        readings.append((now, Reading(joints, (SkinFrame("skin", now, number, values),))))
    return readings


def equal_readings(a: Reading, b: Reading) -> bool:
    """Returns True if the readings are equal bit for bit."""
    arrays = [(a.joints.position, b.joints.position), (a.joints.velocity, b.joints.velocity)]
    arrays += [(a.joints.torque, b.joints.torque), (a.joints.powered, b.joints.powered)]
    arrays += [(x.values, y.values) for x, y in zip(a.skin, b.skin, strict=True)]
    same = all(
        x is y if x is None or y is None else x.dtype == y.dtype and x.tobytes() == y.tobytes()
        for x, y in arrays
    )
    words = [(r.joints.stamp, r.joints.sequence, r.joints.modes) for r in (a, b)]
    frames = [[(f.patch, f.stamp, f.sequence) for f in r.skin] for r in (a, b)]
    return same and words[0] == words[1] and frames[0] == frames[1]
