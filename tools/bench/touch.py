"""Benchmark of simulated skin: a finger touches a robot's arm. MuJoCo's own touch sensors are measured for
comparison."""

from __future__ import annotations

import runpy
import statistics
import subprocess
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import mujoco
import numpy as np
from lxml import etree
from measured import ROUNDS, Measured, each, row

import tci
import tci.lab
from tci.lab.authoring.dense_skin import with_dense_skin, with_skin_rate
from tci.messages import Command, GenericCommand, Mode, Perception
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.generic_arm import JOINTS, SEGMENTS
from tci.simulation import scene
from tci.simulation.hand_model import SIDES, PersonModel
from tci.simulation.touch import skin_geom
from tci.simulation.world import World
from tci.skin.surfaces import Surface

ROOT = Path(__file__).parents[2]
STEP = 0.001
SPAN = 4.0
"""Simulated time [s] of a run."""
RADIUS = 0.005
"""Radius [m] of a touch site."""
NEVER = 1.0
"""Frame rate [Hz] of a simulated skin that is almost never read."""


def pressed(robot: Robot) -> World:
    """Returns a world in which the finger presses the arm with a force of some newtons."""
    world = World(robot, step=STEP)
    patch = robot.patches[0].name
    world.finger.poke(patch, len(world.surfaces[patch].positions) // 2, speed=0.1, depth=0.008)
    world.advance(0.3)
    assert world.finger.touching
    return world


def with_more(robot: Robot, more: Callable[[mujoco.MjSpec, Surface], None]) -> World:
    """Returns a world in which the finger presses the arm, and in which the function `more` adds sensors for
    each patch. TCI's simulated skin is almost never read."""
    original = scene.add_skin

    def add(spec: mujoco.MjSpec, surface: Surface, **options: object) -> None:
        original(spec, surface, **options)
        more(spec, surface)

    scene.add_skin = add
    try:
        return pressed(with_skin_rate(robot, NEVER))
    finally:
        scene.add_skin = original


def sites(spec: mujoco.MjSpec, surface: Surface) -> None:
    """Adds one MuJoCo touch site for each taxel."""
    for i, position in enumerate(surface.positions):
        name = f"{surface.patch}_{i}"
        spec.body(surface.link).add_site(name=name, pos=position, size=[RADIUS, 0.0, 0.0])
        spec.add_sensor(
            name=name,
            type=mujoco.mjtSensor.mjSENS_TOUCH,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            objname=name,
        )


def tactile(spec: mujoco.MjSpec, surface: Surface) -> None:
    """Adds one MuJoCo tactile sensor, which measures the penetration depth at each vertex of the skin
    mesh."""
    name = skin_geom(surface.patch)
    spec.add_sensor(
        name=f"tactile_{surface.patch}",
        type=mujoco.mjtSensor.mjSENS_TACTILE,
        objtype=mujoco.mjtObj.mjOBJ_MESH,
        objname=name,
        reftype=mujoco.mjtObj.mjOBJ_GEOM,
        refname=name,
    )


def step_time(world: World, runs: int = 15) -> float:
    """Returns the time [us] of a simulation step, measured over runs of 20 steps that include skin frames."""
    return each(lambda: world.advance(world.time + 20 * STEP), calls=runs) / 20


def beside(ours: World, peer: World) -> list[tuple[float, float]]:
    return [(step_time(ours), step_time(peer)) for _ in range(ROUNDS)]


def touch() -> list[Measured]:
    nao = tci.load_robot("nao")
    limbs = nao.model_copy(update={"patches": nao.patches[:4]})
    rows = in_contact("whole body", limbs, {150: 1.15, 1000: 2.4, 4000: 6.0})
    with TemporaryDirectory() as folder:
        arm = one_arm(limbs, Path(folder))
        return rows + in_contact("one arm", arm, {150: 1.3, 1000: 3.8, 4000: 10.0})


def one_arm(robot: Robot, folder: Path) -> Robot:
    """Writes the model of a NAO that has only torso and left arm to a file in `folder`, and returns its
    description."""
    assert robot.model is not None
    tree = etree.parse(robot.model.path)
    for body in tree.findall("worldbody/body/body"):
        if body.get("name") != "LShoulder":
            body.getparent().remove(body)
    tree.write(str(folder / "arm.xml"))
    servos = [
        servo if servo.robot_part == "LArm" else servo.model_copy(update={"joint": None})
        for servo in robot.servos
    ]
    patches = [patch for patch in robot.patches if patch.part == "left_arm"]
    model = robot.model.model_copy(update={"path": str(folder / "arm.xml")})
    return robot.model_copy(update={"model": model, "servos": tuple(servos), "patches": tuple(patches)})


def in_contact(what: str, limbs: Robot, faster: dict[int, float]) -> list[Measured]:
    """Returns one row per number of taxels. `faster` contains the target for each number: by which factor
    TCI's step is faster than a step with touch sites."""
    rows = []
    for taxels, wanted in faster.items():
        robot = with_dense_skin(limbs, taxels)
        peer, other = with_more(robot, sites), with_more(robot, tactile)
        for rate in (1000.0, 100.0):
            world = pressed(with_skin_rate(robot, rate))
            name = f"one step with touched skin, {what}, {taxels} taxels, {rate:.0f} frames/s"
            pairs = beside(world, peer)
            rows.append(row(name, "MuJoCo's touch sites, read in each step", pairs, most_ratio=1.0 / wanted))
            rows.append(
                row(name, "MuJoCo's tactile sensors (depths), read in each step", beside(world, other))
            )
            if taxels == 1000:
                nobody = pressed(with_skin_rate(robot, NEVER))
                rows.append(row(name, "TCI, skin never read", beside(world, nobody), most_ratio=1.25))
        force = world.contact_truth(robot.patches[0].name).force
        spread = sum(world.taxels.vectors(patch)[:, 2].sum() for patch in world.surfaces)
        assert abs(spread - force) <= 1e-5 * force, (spread, force)
    return rows


def touch_hand() -> list[Measured]:
    """Measures the cost of touch as the ratio of the time of a step with touch to the time of a step without
    touch. The peer is Gymnasium-Robotics' Shadow hand."""
    lock = ROOT / "requirements" / "bench" / "gymnasium_robotics.txt"
    runpy.run_path(str(ROOT / "tools" / "peers.py"))["install_python"](lock)
    python = ROOT / ".peers" / lock.stem / "bin" / "python"
    command = [str(python), str(Path(__file__).with_name("touch_hand.py")), str(ROUNDS)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True)
    lines = [line.split() for line in answer.stdout.splitlines()]
    theirs = [float(line[1]) / float(line[0]) for line in lines if len(line) == 2][1:]
    robot = tci.load_robot("nao")
    limbs = with_dense_skin(robot.model_copy(update={"patches": robot.patches[:4]}), 1000)
    felt, bare = pressed(limbs), pressed(with_skin_rate(limbs, NEVER))
    pairs = [(a / b, other) for (a, b), other in zip(beside(felt, bare), theirs, strict=True)]
    name = (
        f"time of a step with skin / without skin: NAO with {sum(p.channels for p in limbs.patches)} taxels"
    )
    return [row(name, "hand of Gymnasium-Robotics, 92 sensors", pairs, unit="x", most=1.25)]


STILL = 1e-3
"""Speed [rad/s] that counts as rest."""
POKES = 0.5
"""Time [s] between two pokes. The finger is retracted after half of this time."""


class Poked(tci.Capability[tuple[float, Any]]):
    """Withdrawal reflex on an arm that is poked repeatedly. After each poke an operator moves the arm
    back."""

    def __init__(self, world: World) -> None:
        self.reflex, self.world = tci.WithdrawalReflex(), world
        self.patches = [patch.name for patch in world.robot.patches if patch.segment in SEGMENTS]
        self.steps = self.touched = 0

    def init(self, body: tci.GenericBody) -> tuple[float, Any]:
        return 0.0, self.reflex.init(body)

    def step(
        self, memory: tuple[float, Any], perception: Perception, body: tci.GenericBody
    ) -> tuple[tuple[Command, ...], tuple[float, Any]]:
        due, own = memory
        self.steps += 1
        self.touched += self.world.finger.touching
        commands, own = self.reflex.step(own, perception, body)
        if perception.stamp >= due:
            due += POKES / 2
            if round(2 * due / POKES) % 2:
                patch = self.patches[round(due / POKES) % len(self.patches)]
                taxel = len(self.world.surfaces[patch].positions) // 2
                self.world.finger.poke(patch, taxel, speed=0.2, depth=0.03, gap=0.001)
            else:
                self.world.finger.retire()
                commands = tuple(
                    GenericCommand(part.name, Mode.POSITION, part.initial_posture)
                    for part in self.world.robot.parts
                    if len(part.servos) == len(JOINTS)
                )
        return commands, (due, own)


def keep(velocities: list[Array], tick: tci.Tick) -> None:
    """Appends the commanded velocities [rad/s]. They are evaluated after the run, whose time is measured."""
    velocities.append(tick.sent.velocity)


def real_time_factor() -> list[Measured]:
    """Measures the real-time factor of one robot whose reflex and gate run in every step.

    The robot is touched and moves during half of the time.
    """
    nao, rows = tci.load_robot("nao"), []
    for step, least in ((0.001, 15.0), (0.002, 30.0)):
        binding = nao.binding("sim").model_copy(update={"rate": 1.0 / step})
        robot = nao.model_copy(update={"bindings": (binding,)})
        pairs, touched, moved = [], [], []
        for _ in range(5):
            world = World(robot, step=step)
            capability, velocities = Poked(world), []
            with tci.connect(robot, "sim", world=world) as driver:
                start = time.thread_time()
                tci.run(driver, capability, duration=SPAN, observe=partial(keep, velocities))
                pairs.append((SPAN / (time.thread_time() - start), 1.0))
            touched.append(capability.touched / capability.steps)
            moved.append(sum(bool((np.abs(one) > STILL).any()) for one in velocities) / len(velocities))
        note = f"arm touched for {min(touched):.0%} of the time, moving for {min(moved):.0%}"
        assert min(*touched, *moved) > 0.35, note
        name = f"NAO with skin on both arms, reflex and gate every {1e3 * step:.0f} ms: real-time factor"
        rows.append(row(name, "real time", pairs, unit="x", least_ratio=least, note=note))
    return rows


def people() -> list[Measured]:
    """Measures the real-time factor of a world in which a person's hand presses a forearm, as a fraction of
    that with the finger."""
    rows = []
    for name in ("nao", "g1", "talos"):
        finger = pressed_by_finger(name)
        for hands in (("right",), SIDES):
            world = World(name, people=[PersonModel(hands=hands)])
            world.touch("press 'left forearm' 3N 30s")
            world.advance(1.0)
            assert abs(world.person().right.force - 3.0) < 0.1
            pairs = [(1.0 / step_time(world), 1.0 / step_time(finger)) for _ in range(ROUNDS)]
            what = "a hand presses" if len(hands) == 1 else "a hand presses, another one waits"
            what = f"{name}: {what}: steps per microsecond"
            rows.append(row(what, "the finger presses", pairs, unit="1/us", least_ratio=0.7))
    return rows


def pressed_by_finger(name: str) -> World:
    world = World(name)
    patch = next(one.name for one in world.robot.patches if one.segment == "forearm")
    world.finger.poke(patch, len(world.surfaces[patch].positions) // 2, speed=0.1, depth=0.00375)
    world.advance(0.3)
    assert world.finger.touching
    return world


def worlds() -> list[Measured]:
    """Times two simulated worlds that run at the same time on two cores."""
    pairs = []
    for _ in range(3):
        # The runs are so long that all worlds are computed at the same time. The first run of each process
        # also loads modules, and is not counted.
        fast, slow = (
            statistics.median(
                run.simulated / run.took
                for run in tci.lab.simulate("nao", worlds=8 * cores, cores=cores, duration=SPAN)
                if run.world >= cores
            )
            for cores in (2, 1)
        )
        pairs.append((fast, slow))
    return [
        row(
            "2 simulated worlds on 2 cores: speed of each",
            "worlds in turn on 1 core",
            pairs,
            unit="x",
            least_ratio=0.8,
        )
    ]
