"""Trials of `tci.Gentle` on a plant that shares nothing with the gate: an arm on its way meets somebody.

Nothing of the capability is used but its commands; plant, partner and forces are those of `rigid_robot`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import tci
from helpers.handled import Hand, HandledRobot
from helpers.rigid_robot import AWAY, SURFACE_MASS, Person, RigidDriver
from tci.messages import GenericCommand, JointReading, Mode, Order
from tci.messages.frames import Array, read_only
from tci.robot.description import Patch
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.runtime.loop import run
from tci.skin.skin import Skin

RADIUS = 0.03
PAD = 0.01
"""Mass [kg] of the skin of a soft hand: 50 g on 1.5 N/mm bounce for 18 ms, a lost contact and a blow."""
HERE = 2.5
"""Time [s] for which the partner stays."""
COMES = 1.0
"""Time [s] in which a partner who moves comes; it goes away in the same time."""
MOST = 40.0
"""Longest trial [s]. At the 0.05 m/s that `Gentle` goes by itself, joints that turn by 1.2 rad together at an
arm's length of 0.6 m need 15 s, and it gives way on its way."""
FIRST = 0.3
"""Time [s] from the first contact on within which its first peak comes."""
BEFORE = 0.03
ARRIVED = 2.0
"""Angle [deg] to the goal within which the arm has reached it."""


class Go(tci.Capability[bool]):
    """Moves an arm to a posture, once."""

    def __init__(self, part: str, goal: Array) -> None:
        self.part, self.goal = part, goal

    def init(self, body: tci.GenericBody) -> bool:
        return False

    def step(
        self, memory: bool, perception: tci.Perception, body: tci.GenericBody
    ) -> tuple[tuple[Order, ...], bool]:
        return (() if memory else (GenericCommand(self.part, Mode.POSITION, self.goal),)), True


@dataclass(frozen=True)
class Outcome:
    patch: str
    peak: float
    """[N]"""
    late: float
    """Largest force [N] from 1 s after the first contact on, a mean of 20 ms."""
    high: float
    """95th percentile of the force [N] since the first contact."""
    step: float
    """Force [N] of one step of the encoders: the partner's stiffness times the way of the contact."""
    kept: float
    """Share of the time with contact: while a partner who stands was there, or one who moves came for the
    first time. Who goes away faster than an arm may come back is lost."""
    left: float
    """Angle [deg] to the goal at the end, after the partner has left."""
    arrives: float
    """When it reached the goal [s], since the partner left; inf if it did not."""
    felt: bool
    """Skin felt it; on links without skin the gate answers."""
    state: str
    force: tuple[Array, Array]
    """Times [s] since the first contact and forces [N], while the partner is there."""
    first: float
    """Largest force [N] of the first `FIRST`."""
    taxel: int
    joints: JointReading
    """Where it was met, and where the joints were then."""
    closing: float
    """Speed [m/s] of this place towards a partner who stands, a mean of `BEFORE`; NaN if met at once."""
    period: float
    """Of the loop [s]."""


def meet(
    name: str, seed: int, *, cap: float, stiffness: float, speed: float = 0.0, lasts: float = np.inf,
    free: bool = False, delay: float = 0.05,
) -> Outcome | None:  # fmt: skip
    """An arm meets a partner on a spring, who stands or moves towards it and back with up to `speed` [m/s]:
    on a way that nobody changes or, if `free`, as a hand that a person's arm moves.
    The arm thinks that its answer takes `delay` [s]. The trial ends `lasts` [s] after the first contact at
    the latest. None if no skin of the arm goes ahead on its way, or nobody is met from outside."""
    random, robot = np.random.default_rng(seed), tci.load_robot(name)
    part = str(random.choice([one.name for one in robot.parts if one.kind == "arm"]))
    start = np.deg2rad(random.uniform([10, 10, -10, 40, 0], [40, 35, 10, 80, 1]))
    way = random.choice([-1.0, 1.0]) * np.array([0.6, 0, 0, 0, 0]) * random.uniform(0.7, 1.2)
    goal = start + way + np.array([0, random.uniform(0, 0.3), 0, random.uniform(-0.2, 0.2), 0])
    patches = [one for one in robot.skin if one.part == part and one.segment]
    if not patches:  # its palm meets who stands at its side
        patches, start = _on_hand(robot, part), start + np.deg2rad([0, 30, 0, 0, 0])
        goal = start - np.array([0, np.abs(way[0]), 0, 0, 0])
    patch = patches[int(random.integers(len(patches)))]
    share, rate = random.uniform(0.3, 0.6), float(random.choice([100.0, 500.0]))
    angles = angles_of(robot, part, start)
    skin = Skin(robot)
    before, normals = skin_at(skin, patch.name, angles_of(robot, part, start + share * (goal - start)))
    after, _ = skin_at(skin, patch.name, angles_of(robot, part, start + (share + 0.02) * (goal - start)))
    moved = after - before
    ahead = (moved * normals).sum(axis=1)
    first = np.flatnonzero(ahead > 0.8 * np.linalg.norm(moved, axis=1).max())
    if not len(first):
        return None
    taxel = int(random.choice(first))
    partner = Person("partner", stiffness, radius=RADIUS, surface=PAD if speed else SURFACE_MASS)
    plant = HandledRobot(robot, people=[partner], seed=seed, angles=angles, rate=rate)
    T_TL = KinematicChain(robot).poses(angles, [patch.link])[patch.link]
    position, rotation = plant.link_pose(patch.link)
    R_WT = rotation @ T_TL[:3, :3].T
    place = position + R_WT @ (before[taxel] + RADIUS * normals[taxel] - T_TL[:3, 3])
    away = R_WT @ normals[taxel]
    plant.place("partner", place)
    if min(plant.gaps("partner", place).values()) < 0.0:  # a bent arm would begin inside them
        return None
    hand = Hand(plant, "partner", place, -away, speed)
    plant.hands = (hand,) if free else ()
    felt, joints = plant.felt["partner"], joint_map(robot, part)
    felt_by = {one.name for one in robot.skin if one.part == part or one in patches}
    skin_felt: list[bool] = []
    local = skin.surfaces[patch.name].positions[taxel]
    path: list[tuple[float, Array, Array]] = []

    def see(tick: Any) -> None:
        if felt.first is None:
            there, turned = plant.link_pose(patch.link)
            path.append((plant.time, there + turned @ local, plant.position))
        skin_felt.append(any(one.patch in felt_by for one in tick.perception.contacts))
        if felt.first is None:
            return
        since = tick.now - felt.first
        if since > HERE:
            hand.gone = True
            plant.shift("partner", AWAY)
        elif speed and not free:
            plant.shift("partner", place - away * speed / np.pi * (1.0 - np.cos(np.pi * since)))

    def left() -> float:
        return float(np.degrees(np.abs(joints.to_generic(plant.position) - goal)[joints.ids].max()))

    result = run(
        RigidDriver(plant), tci.Gentle(Go(part, goal), cap=cap, delay=delay), duration=MOST, observe=see,
        until=lambda memory: felt.first is not None and (
            plant.time > felt.first + lasts
            or (plant.time > felt.first + HERE + 0.5 and left() < ARRIVED)
        ),
    )  # fmt: skip
    if felt.first is None:
        return None
    times, forces = np.array(felt.time), np.array(felt.force)
    there = (times >= felt.first) & (times <= felt.first + HERE)
    smooth = np.convolve(forces, np.ones(40) / 40.0, mode="same")
    lengths = sum(one.length for one in robot.part(part).segments)
    return Outcome(
        patch.name, felt.peak, float(smooth[there & (times >= felt.first + 1.0)].max(initial=0.0)),
        float(np.percentile(forces[there], 95)), stiffness * lengths * plant._count,
        float((forces[there & (times <= felt.first + (COMES if speed else HERE))] > 0.1).mean()), left(),
        plant.time - felt.first - HERE if left() < ARRIVED else np.inf,
        sum(skin_felt) > 0.5 * min(HERE, lasts) * rate * 0.5, result.state.name,
        (times[there] - felt.first, forces[there]),
        float(forces[there & (times <= felt.first + FIRST)].max()), taxel,
        JointReading(felt.first, 0, read_only(path[-1][2]), read_only(np.zeros(len(angles)))),
        _closing(path, away), 1.0 / rate,
    )  # fmt: skip


def _on_hand(robot: tci.Robot, part: str) -> list[Patch]:
    """The skin of the hand that an arm carries."""
    side = robot.part(part).side
    return [
        one
        for one in robot.skin
        if robot.part(one.part).kind in ("hand", "fingers") and robot.part(one.part).side == side
    ]


def _closing(path: list[tuple[float, Array, Array]], away: Array) -> float:
    recent = [one for one in path if one[0] >= path[-1][0] - BEFORE - 1e-6]
    if len(recent) < 2 or path[-1][0] - path[0][0] < 2.0 * BEFORE:
        return float("nan")
    return float(away @ (recent[-1][1] - recent[0][1])) / (recent[-1][0] - recent[0][0])


def angles_of(robot: tci.Robot, part: str, generic: Array) -> Array:
    angles, joints = np.array(initial_position(robot)), joint_map(robot, part)
    angles[joints.servos] = joints.to_robot(generic, angles)
    for servo in robot.servos:
        low, high = servo.limits.lower, servo.limits.upper
        if low is not None and high is not None:
            angles[servo.index] = np.clip(angles[servo.index], low + 1e-3, high - 1e-3)
    return angles


def skin_at(skin: Skin, patch: str, angles: Array) -> tuple[Array, Array]:
    joints = JointReading(0.0, 0, read_only(angles), read_only(np.zeros(len(angles))))
    return skin.positions(patch, joints, frame="torso"), skin.normals(patch, joints, frame="torso")
