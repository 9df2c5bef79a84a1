"""A finger rests on a robot's skin in any posture, a capability responds, and the simulation measures the
contact force.

The criterion is MuJoCo's contact force on the finger, which does not depend on TCI's normals, Jacobians and
limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import tci
from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.capability import Capability
from tci.capabilities.soft_reaction import SoftReaction
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.simulated import SimulatedDriver
from tci.lab.experiments.poke import Stimulus
from tci.messages import Mode
from tci.messages.frames import Array
from tci.robot.description import GenericPart, Patch, Robot
from tci.robot.description.patch import Table
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.simulation.world import World

RESTS = 0.2
"""Time [s] after which a finger that approached at 0.25 m/s rests on the skin."""
NEXT = 0.02
"""Time [s] after the first command in which the force must not increase."""
RISE = 1e-3
"""Tolerated increase [N] of the force, because the servos of the arm are still settling."""
AT_LIMIT = 0.1
"""Fraction of the servos that are at their lower limit, and equal fraction that are at their upper limit."""
SHORT_POKE = Stimulus(duration=0.65)
"""Poke of the demo with a shorter duration. Contact begins within 60 ms and must end 500 ms later. The
remaining time shows that the arm does not return."""
SHEET, SPACING = 5, 0.01
"""Number of taxels along each edge of a pad, and the distance [m] between them."""


@dataclass(frozen=True)
class Touched:
    """Result of one touch."""

    answered: bool
    notes: tuple[str, ...]
    rise: float = 0.0
    """Increase [N] of the force within NEXT of the first command."""


def press(
    world: World,
    patch: str,
    taxel: int,
    capability: Capability[Any],
    *,
    depth: float,
    watch: float = NEXT,
    body: GenericBody | None = None,
) -> Touched:
    """Presses a finger `depth` [m] into the skin over a taxel, waits until it rests, and then runs a
    capability.

    The capability runs for `watch` [s] after its first command. `body` is the robot's body, by default a new
    one. Raises TciError if there is no room for the finger.
    """
    world.reset()
    surface = world.surfaces[patch]
    place = surface.positions[taxel], surface.normals[taxel]
    world.finger.poke(patch, *place, speed=0.25, depth=depth, gap=0.002)
    driver, body = SimulatedDriver(world.robot, world=world), body or GenericBody(world.robot)
    perceiver, memory = Perceiver(body), capability.init(body)
    first, before, rise, notes = None, 0.0, 0.0, dict[str, None]()
    with driver:
        for now in driver.ticks(duration=RESTS + 0.1 + watch):
            if first is not None:
                if now > first + watch:
                    break
                rise = max(rise, world.finger.force - before)
            reading = driver.read()
            seen = perceiver.step(reading, now)
            orders: Sequence[Any] = ()
            if now >= RESTS:
                orders = capability.begin(seen, body) if not notes and first is None else ()
                more, memory = capability.step(memory, seen, body)
                orders = (*orders, *more)
                notes |= dict.fromkeys(capability.notes(memory))
                if first is None and any(_moves(order) for order in more):
                    first, before = now, world.finger.force
            platform, refused = body.to_platform(orders, reading.joints)
            assert not refused
            driver.write(driver.gate.step(platform, reading.joints, now))
    return Touched(first is not None, tuple(notes), rise)


def _moves(order: Any) -> bool:
    return bool(order.mode is Mode.POSITION or np.any(order.values))


def capability_for(part: str) -> Capability[Any]:
    """Returns the reflex that responds to touches of this part."""
    return WithdrawalReflex() if part.endswith("_arm") else BodyWithdrawal(stance="supported")


def any_posture(robot: Robot, chance: np.random.Generator) -> dict[str, Array]:
    """Returns random generic angles of all parts. Some servos are at their limits."""
    position = np.array(initial_position(robot))
    for servo in robot.servos:
        lower, upper = servo.limits.lower, servo.limits.upper
        if lower is not None and upper is not None:
            share = chance.uniform(-AT_LIMIT, 1.0 + AT_LIMIT)
            position[servo.index] = np.clip(lower + share * (upper - lower), lower, upper)
    return {part.name: joint_map(robot, part.name).to_generic(position) for part in robot.parts}


def with_pad(
    robot: Robot, part: str, link: str, folder: Path, *, centre: Array, normal: Array, segment: str = ""
) -> Robot:
    """Returns the robot with one more patch: a sheet of taxels on a link of a part.

    Its `centre` (3,) [m] is relative to the link's origin. Its normal may have any direction (3,).
    """
    across = np.linalg.svd(normal[None])[2][1:]
    grid = SPACING * (np.arange(SHEET) - SHEET // 2)
    lines = ["x [m], y [m], z [m], nx, ny, nz, area [m2]"]
    for one in grid:
        for other in grid:
            row = [*(centre + one * across[0] + other * across[1]), *normal]
            lines.append(", ".join(f"{value:.9f}" for value in row) + ", 1e-4")
    file = folder / "pad.csv"
    file.write_text("\n".join(lines) + "\n")
    pad = Patch(
        name="pad", part=part, segment=segment, link=link, rate=100.0, channels=SHEET * SHEET,
        sensor=robot.patches[0].sensor, surface=Table(file=str(file), format="csv"),
    )  # fmt: skip
    return robot.model_copy(update={"patches": (*robot.patches, pad)})


def any_pad(robot: Robot, chance: np.random.Generator, folder: Path) -> Robot:
    """Returns the robot with a pad on a random link that a random part moves. Arms are left out."""
    kinematics = KinematicChain(robot)
    places: list[tuple[GenericPart, str, str]] = []
    for part in robot.parts:
        own = set(joint_map(robot, part.name).servos.tolist())
        if not own or part.kind == "arm":
            continue
        links = [link for link in kinematics.links if set(kinematics.chain(link)[-1:]) & own]
        if part.kind == "torso":
            assert robot.model is not None
            links = [robot.model.torso_link]
        segments = ("thigh", "shank", "foot") if part.kind == "leg" else ("",)
        places += [(part, link, segment) for link in links for segment in segments]
    part, link, segment = places[chance.integers(len(places))]
    normal = chance.normal(size=3)
    normal /= np.linalg.norm(normal)
    centre = 0.05 * normal + chance.uniform(-0.03, 0.03, size=3)
    return with_pad(robot, part.name, link, folder, centre=centre, normal=normal, segment=segment)


@dataclass(frozen=True)
class Tally:
    """Results of many touches."""

    touches: int
    answered: int
    refused: int
    rises: tuple[str, ...]
    """Touches during which the force increased, as text."""
    worst: float
    """Largest increase [N] of the force."""


def tally(name: str, seed: int, count: int, folder: Path) -> Tally:
    """Touches random taxels of a robot in random postures. Every second robot has an additional pad at a
    random place."""
    chance = np.random.default_rng([seed, *name.encode()])
    answered = refused = touches = 0
    worst, rises = 0.0, []
    bare = tci.load_robot(name)
    while touches < count:
        padded = touches % 2 == 0
        robot = any_pad(bare, chance, folder) if padded else bare
        worn = ["pad"] if padded else [patch.name for patch in robot.patches]
        posture = any_posture(robot, chance)
        world, body = World(robot, posture=posture), GenericBody(robot)
        for _ in range(5):
            patch = robot.patch(worn[chance.integers(len(worn))])
            taxel = int(chance.integers(len(world.surfaces[patch.name].positions)))
            soft = chance.random() < 0.2
            reflex = SoftReaction(parts=(patch.part,)) if soft else capability_for(patch.part)
            try:
                depth = chance.uniform(0.002, 0.01)
                told = press(world, patch.name, taxel, reflex, depth=depth, body=body)
            except tci.TciError:  # no room for the finger
                continue
            touches += 1
            answered += told.answered
            refused += bool(told.notes)
            worst = max(worst, told.rise)
            if told.rise > RISE:
                what = f"{name} {seed}: {patch.name} of {patch.part} on {patch.link}, taxel {taxel}"
                rises.append(f"{what}, {type(reflex).__name__}: {told.rise:.3g} N")
    return Tally(touches, answered, refused, tuple(rises), worst)
