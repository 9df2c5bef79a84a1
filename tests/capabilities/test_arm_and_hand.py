"""What people do to humanoids works on one arm in sleeves of 64 taxels (franka), also on a wall, and on one
hand (allegro). `test_teach.py` teaches the arm.

Forces on people and angles of joints are those of the simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tci
from helpers.gentled import Go, angles_of, skin_at
from helpers.taught import off
from tci.capabilities import FingerReflex, Sway
from tci.lab.authoring.proposal import propose
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.poke import Stimulus
from tci.robot.description import TruncatedCone
from tci.runtime.loop import Tick
from tci.simulation import Obstacle
from tci.skin.skin import Skin


@pytest.mark.parametrize(
    ("name", "patch", "reflex", "says"),
    [
        ("franka", "left_forearm", tci.WithdrawalReflex(), "panda_joint"),
        ("allegro", "right_middle_tip", FingerReflex(), "joint_"),
    ],
)
def test_the_five_lines(name: str, patch: str, reflex: tci.Capability[Any], says: str) -> None:
    with tci.connect(name, "sim") as driver:
        driver.world.finger.poke(patch, 20)
        result = tci.run(driver, reflex, duration=0.8)
    assert f"touched {patch}" in str(result)
    assert f"moved {says}" in str(result)


def on_a_wall() -> tci.Robot:
    """A UR5 that is proposed on a wall, in sleeves of 64 taxels."""
    model = tci.load_robot("ur5").model
    assert model is not None
    robot = propose(Path(model.path), name="ur5", package=model.package, mount="wall")
    patches = []
    for patch in robot.patches:
        assert isinstance(patch.surface, TruncatedCone)
        cone = patch.surface.model_copy(update={"rings": 8, "per_ring": 8})
        patches.append(patch.model_copy(update={"surface": cone, "channels": 64}))
    return robot.model_copy(update={"patches": tuple(patches), "digest": "on a wall"})


@pytest.mark.parametrize("robot", ["wall", "allegro"])
def test_the_demo(robot: str) -> None:
    one = on_a_wall() if robot == "wall" else tci.load_robot(robot)
    for trial in trials_of(one, tci.WithdrawalReflex(), stimulus=Stimulus(), seed=0, count=2):
        assert trial.responded, trial.site
        assert trial.contact_lost_ms is not None, trial.site
        assert trial.contact_lost_without_reflex_ms is None, trial.site
        assert not trial.violations


class Still(tci.Capability[None]):
    """Moves nothing."""

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(
        self, memory: None, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[tci.GenericCommand, ...], None]:
        return (), None


def felt(robot: str | tci.Robot, touch: str, capability: tci.Capability[Any], duration: float) -> np.ndarray:
    """A hand touches a robot. Rows (k, 5): time [s], force [N] and place [m] in its link's frame of each
    contact."""
    rows: list[tuple[float, ...]] = []

    def see(tick: Tick) -> None:
        rows.extend((tick.now, one.force, *one.p_L) for one in tick.perception.contacts)

    with tci.connect(robot, "sim", people=1) as driver:
        driver.world.touch(touch)
        result = tci.run(driver, capability, duration=duration, observe=see)
    assert result.state.name == "RUN"
    return np.array(rows)


def test_a_stroke_is_felt_along_an_arm_and_along_a_finger_and_a_poke_on_the_palm() -> None:
    for robot in ("franka", on_a_wall()):
        stroke = felt(robot, "stroke 'left forearm' 3N 8cm/s", Still(), 2.5)
        assert np.ptp(stroke[:, 2:], axis=0).max() > 0.05
    along = felt("allegro", "stroke 'right index finger' 2N 5cm/s", Still(), 2.5)
    assert np.ptp(along[:, 4]) > 0.01 > np.ptp(along[:, 2:4], axis=0).max()  # the finger points along z
    tap = felt("allegro", "tap 'right index finger' 3N", Still(), 1.2)
    assert 1.5 < tap[:, 1].max() < 4.5
    poke = felt("allegro", "poke 'palm of right hand' 3N", Still(), 1.2)
    assert 1.5 < poke[:, 1].max() < 4.5


def test_a_gentle_arm_gives_way_to_a_push() -> None:
    """A first peak is at most 27 N (docs/gentle.md)."""
    rows = felt("franka", "push 'left forearm'", tci.Gentle(Sway()), 1.5)
    assert 5.0 < rows[:, 1].max() <= 27.0


def test_a_finger_of_a_lone_hand_is_guided_and_repeats_it() -> None:
    path: list[tuple[float, np.ndarray]] = []
    with tci.connect("allegro", "sim", people=1) as driver:
        world = driver.world
        world.touch(["push 'right_index_tip taxel 45' 4N 0.9s @0.3s", "tap 'palm of right hand' 2N @1.9s"])

        def see(tick: Tick) -> None:
            path.append((tick.now, np.array(world.joints().position)))

        result = tci.run(driver, tci.Teach(), duration=5.0, observe=see)
    assert result.state.name == "RUN"
    assert result.memory.motion is not None, "a tap on the palm ends the lesson"
    led = [one for one in path if 0.3 < one[0] < 1.5]
    assert np.degrees(np.ptp([angles[1] for _, angles in led])) > 10.0, "the index finger bends"
    assert off(led, [one for one in path if one[0] > 2.5])[0] <= 2.0


@pytest.mark.parametrize(("cap", "stiffness"), [(5.0, 10e3), (10.0, 25e3), (15.0, 75e3)])
def test_a_finger_on_its_way_gives_way_to_a_person_and_then_goes_on(cap: float, stiffness: float) -> None:
    part, tip, radius = "right_fingers", "right_index_tip", 0.02
    robot = tci.load_robot("allegro")
    start, bends = robot.part(part).initial_posture, np.arange(10) == 3
    meets, goal = start + np.deg2rad(12.0) * bends, start + np.deg2rad(30.0) * bends
    positions, normals = skin_at(Skin(robot), tip, angles_of(robot, part, meets))
    rows: list[tuple[float, float]] = []
    person = Obstacle(name="person", stiffness=stiffness, radius=radius)
    with tci.connect(robot, "sim", rate=100.0, obstacles=[person]) as driver:
        world = driver.world
        world.obstacle("person").place(positions[0] + (radius + 1e-3) * normals[0])

        def see(tick: Tick) -> None:
            rows.append((tick.now, world.contact_truth(tip).force))
            first = next((now for now, force in rows if force > 1.0), np.inf)
            if tick.now > first + 2.0:
                world.obstacle("person").remove()

        result = tci.run(driver, tci.Gentle(Go(part, goal), cap=cap), duration=5.5, observe=see)
        end = np.array(world.joints().position)
    times, forces = np.array(rows).T
    met = forces > 1.0
    assert met.any()
    first = times[met][0]
    assert forces.max() <= 27.0
    assert forces[times > first + 1.0].max() <= 1.1 * cap
    assert np.degrees(np.abs(end - angles_of(robot, part, goal)).max()) < 2.0
    assert result.state.name == "RUN"
