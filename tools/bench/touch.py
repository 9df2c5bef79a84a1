"""Simulated skin: a finger on a robot's arm, beside the same world with MuJoCo's own touch sensors."""

from __future__ import annotations

import statistics
import time

import mujoco
from measured import ROUNDS, Measured, each, row

import tci
from tci.model.dense_skin import with_dense_skin
from tci.model.description import Robot
from tci.model.surfaces import Surface
from tci.simulation import scene
from tci.simulation.world import World
from tci.trials.experiment import with_skin_rate

STEP = 0.001
RADIUS = 0.005
"""Of a touch site [m]."""
NEVER = 1.0
"""Frames per second where our skin is there, but as good as never read."""


def pressed(robot: Robot) -> World:
    """A world in which the finger rests on the arm with some newtons."""
    world = World(robot, step=STEP)
    patch = robot.patches[0].name
    world.finger.poke(patch, len(world.surfaces[patch].positions) // 2, speed=0.1, depth=0.008)
    world.advance(0.3)
    assert world.finger.touching
    return world


def with_sites(robot: Robot) -> World:
    """The same, with one of MuJoCo's touch sites per taxel."""
    original = scene.add_skin

    def add(spec: mujoco.MjSpec, surface: Surface, **options: object) -> None:
        original(spec, surface, **options)  # type: ignore[arg-type]
        for i, position in enumerate(surface.positions):
            name = f"{surface.patch}_{i}"
            spec.body(surface.link).add_site(name=name, pos=position, size=[RADIUS, 0.0, 0.0])
            spec.add_sensor(
                name=name,
                type=mujoco.mjtSensor.mjSENS_TOUCH,
                objtype=mujoco.mjtObj.mjOBJ_SITE,
                objname=name,
            )

    scene.add_skin = add
    try:
        return pressed(with_skin_rate(robot, NEVER))
    finally:
        scene.add_skin = original


def step_time(world: World, runs: int = 15) -> float:
    """Microseconds of a step: over runs of 20, a frame of the slowest skin in each."""
    return each(lambda: world.advance(world.time + 20 * STEP), calls=runs) / 20


def beside(ours: World, peer: World) -> list[tuple[float, float]]:
    return [(step_time(ours), step_time(peer)) for _ in range(ROUNDS)]


def touch() -> list[Measured]:
    nao, rows = tci.load_robot("nao"), []
    limbs = nao.model_copy(update={"patches": nao.patches[:4]})
    for taxels, wanted in ((150, 1 / 1.15), (1000, 1 / 2.4), (4000, 1 / 6)):
        robot = with_dense_skin(limbs, taxels)
        peer = with_sites(robot)
        for rate in (1000.0, 100.0):
            world = pressed(with_skin_rate(robot, rate))
            name = f"simulated skin in contact, {taxels} taxels, {rate:.0f} frames/s"
            rows.append(
                row(f"{name}: step", "MuJoCo touch sites, each step", beside(world, peer), most_ratio=wanted)
            )
        force = world.contact_truth(robot.patches[0].name).force
        spread = sum(world._taxels.vectors(patch)[:, 2].sum() for patch in world.surfaces)
        assert abs(spread - force) <= 1e-5 * force, (spread, force)
        if taxels == 1000:
            nobody = pressed(with_skin_rate(robot, NEVER))
            rows.append(row(f"{name}: step", "the same, never read", beside(world, nobody), most_ratio=1.25))
    return rows


def worlds() -> list[Measured]:
    """Many worlds on several cores, and one robot with reflex and gate in every step."""
    nao, rows = tci.load_robot("nao"), []
    for step, least in ((0.001, 15.0), (0.002, 30.0)):
        binding = nao.binding("sim").model_copy(update={"rate": 1.0 / step})
        robot = nao.model_copy(update={"bindings": (binding,)})
        pairs = []
        for _ in range(5):
            world = pressed(robot) if step == STEP else World(robot, step=step)
            with tci.connect(robot, "sim", world=world) as link:
                start = time.thread_time()
                tci.run(link, tci.WithdrawalReflex(), duration=1.0)
                pairs.append((1.0 / (time.thread_time() - start), 1.0))
        name = f"NAO, both arms' skins, reflex and gate each {1e3 * step:.0f} ms: real-time factor"
        rows.append(row(name, "real time", pairs, unit="x", least_ratio=least))
    pairs = []
    for _ in range(5):
        alone, beside_others = (tci.simulate("nao", worlds=4, cores=cores) for cores in (1, 4))
        fast, slow = (
            statistics.median(run.simulated / run.took for run in runs) for runs in (beside_others, alone)
        )
        pairs.append((fast, slow))
    rows.append(
        row("4 worlds on 4 cores: speed of each", "one after the other", pairs, unit="x", least_ratio=0.8)
    )
    return rows
