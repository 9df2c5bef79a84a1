"""Judge of `tci.Teach`: hands that guide an arm, and tap, on a plant that shares nothing with the gate.

A hand is a mass that the person's arm pulls along, behind a soft pad: the person wants it to move at a steady
speed into the skin, and keeps it beside the place that it touched. Nothing of the capability is used but its
commands; plant and forces are those of `rigid_robot`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import mujoco
import numpy as np

import tci
from helpers.gentled import angles_of, skin_at
from helpers.handled import HandledRobot
from helpers.rigid_robot import AWAY, ROBOT, STEP, Person, RigidDriver
from tci.gestures import Gesture, fit
from tci.messages import JointReading
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.runtime.loop import run
from tci.skin.skin import Skin
from tci.testing import PERIOD, TouchedRobot
from tci.touches.person import Person as Toucher

SPEED = 0.2
"""Speed [m/s] at which people guide."""
STARTS = 0.15
"""Time [s] in which a hand gets this speed."""
BESIDE = 0.05
"""Time constant [s] with which a hand stays beside the place that it touched."""
MEASURED = 0.3
"""Time [s] after the first contact from which on forces count."""
GUIDES = 1.1
"""Time [s] for which a hand pushes."""
BACK = 6.0
"""Time [s] for the way back, as long as `Teach` has patience: the hand goes at 0.15 m/s, and an arm of 0.7 m
that was pushed near its shoulder needs more than 4 s. With 3 s it was judged in the middle of its motion."""
PATIENT = 0.1
"""Age [s] of readings that a slow loop takes, as over a G1's topics: one in 14 comes a period late."""
RADIUS = 0.012
ON_LINK = 0.02
"""Distance [m] of a taxel from its link's surface up to which the plant feels there."""
LEAST = 0.07
"""Lever [m] below which nobody guides an arm: it would be pushed along its own length."""
FREE = float(np.deg2rad(3.0))
"""Angle [rad] to a joint's limit within which no arm goes on."""


@dataclass
class Guide:
    """A hand that pushes a place of a link."""

    plant: GuidedRobot
    name: str
    link: str
    p_L: Array
    n_L: Array
    mass: float
    """[kg]"""
    arm: float
    """Stiffness [N/m] of the person's arm."""
    damping: float
    """Ratio on it."""
    pad: float
    speed: float = SPEED
    begins: float = 0.5
    """[s]"""
    lasts: float = GUIDES
    first: float | None = None
    """Time [s] of the first contact."""
    rows: list[tuple[float, float]] = field(default_factory=list)
    """Time [s] and force [N]."""
    elsewhere: bool = False
    """It touched another link: there was no room for it."""
    _height: float = 0.0
    _x: Array | None = None
    _v: Array = field(default_factory=lambda: np.zeros(3))
    _wanted: Array = field(default_factory=lambda: np.zeros(3))

    def step(self) -> None:
        """One step of the hand, before that of the plant."""
        now = self.plant.time
        if now < self.begins or (self.first is not None and now > self.first + self.lasts):
            if self._x is not None:
                self.plant.shift(self.name, AWAY)
                self._x = None
            return
        position, rotation = self.plant.link_pose(self.link)
        n = rotation @ self.n_L
        if self._x is None:
            self._height = self.plant.height(self.link, self.p_L, self.n_L)
        place = position + rotation @ self.p_L + self._height * n
        if self._x is None:
            self._x = place + 2e-3 * n
            self._wanted = self._x.copy()
        spring = self.plant.pressed(self.name)
        force = float(np.linalg.norm(spring))
        if self.first is None and force > 0.3:
            self.first = now
        self.elsewhere |= force > 0.3 and self.plant.touches_other(self.name, self.link)
        pace = 0.1 if self.first is None else min(1.0, 0.1 + (now - self.first) / STARTS)
        apart = place - self._wanted
        beside = (apart - (apart @ n) * n) / BESIDE
        speed = beside - pace * self.speed * n
        self._wanted = self._wanted + STEP * speed
        damper = 2.0 * self.damping * np.sqrt(self.arm * self.mass)
        pull = self.arm * (self._wanted - self._x) + damper * (speed - self._v) + spring
        self._v = self._v + STEP * pull / self.mass
        self._x = self._x + STEP * self._v
        self.plant.shift(self.name, self._x)
        self.rows.append((now, force))

    @property
    def force(self) -> tuple[Array, Array]:
        """Times [s] since the first contact, and forces [N]."""
        rows = np.array(self.rows)
        return rows[:, 0] - (self.first or 0.0), rows[:, 1]


class GuidedRobot(HandledRobot):
    """The plant, asked where hands touch it."""

    def height(self, link: str, p_L: Array, n_L: Array) -> float:
        """How far above a point of a link a hand's middle is when it first touches it [m]: skin lies above or
        in the hulls that touch."""
        model, data = self.model, mujoco.MjData(self.model)
        data.geom_xpos[:], data.geom_xmat[:] = self.data.geom_xpos, self.data.geom_xmat
        weld = model.body_weldid[model.body(link).id]
        hulls = np.flatnonzero((model.body_weldid[model.geom_bodyid] == weld) & (model.geom_contype == ROBOT))
        position, rotation = self.link_pose(link)
        own, n, height = model.geom(self.people[0].name).id, rotation @ n_L, 0.05
        for _ in range(8):
            data.geom_xpos[own] = position + rotation @ p_L + height * n
            height -= min(
                mujoco.mj_geomDistance(model, data, own, hull, 0.1, None) for hull in hulls.tolist()
            )
        return height

    def touches_other(self, name: str, link: str) -> bool:
        """True if a person's surface touches another link than `link`."""
        model, own = self.model, self.model.geom(name).id
        weld = model.body_weldid[model.body(link).id]
        geoms = [
            {*one.geom.tolist()} - {own} for one in self.data.contact[: self.data.ncon] if own in one.geom
        ]
        return any(model.body_weldid[model.geom_bodyid[geom]] != weld for pair in geoms for geom in pair)


@dataclass
class Tap:
    """A finger that comes down on a place at certain times, each time for a moment."""

    plant: GuidedRobot
    name: str
    link: str
    p_L: Array
    n_L: Array
    times: tuple[float, ...]
    """[s]; may be set later."""
    length: float = 0.1
    """[s]"""
    depth: float = 2e-3
    """[m]"""
    felt: bool = False
    """The skin of the plant felt it."""

    def step(self) -> None:
        now = self.plant.time
        if not self.felt and float(np.linalg.norm(self.plant.pressed(self.name))) > 0.5:
            self.felt = self.plant.on_skin()
        deep = max(
            (np.sin(np.pi * (now - at) / self.length) for at in self.times if at <= now <= at + self.length),
            default=-1.0,
        )
        if deep < 0.0:
            self.plant.shift(self.name, AWAY)
            return
        position, rotation = self.plant.link_pose(self.link)
        n = rotation @ self.n_L
        away = self.plant.height(self.link, self.p_L, self.n_L) + 2e-3 - (self.depth + 2e-3) * deep
        self.plant.shift(self.name, position + rotation @ self.p_L + away * n)


@dataclass(frozen=True)
class Outcome:
    robot: str
    patch: str
    rate: float
    pad: float
    seconds: float
    """Measured time [s]: until a joint came to its limit, or the gate stopped the arm before a collision."""
    median: float
    high: float
    """Median and 95th percentile of the force [N], from `MEASURED` on."""
    kept: float
    """Share of that time with contact."""
    peak: float
    """Largest force [N], from the first contact on."""
    tapped: bool
    """The skin of the other arm was touched by the tap."""
    off: float
    """Between the taught and the repeated path [deg], r.m.s. over time of the joint that is worst."""
    state: str
    why: str
    """Why the time was short."""
    force: tuple[Array, Array]
    """Times [s] since the first contact, and forces [N]."""
    taught: tuple[Array, Array]
    repeated: tuple[Array, Array]
    """Times [s] since their begin, and generic angles (k, n) [rad]."""
    gesture: Gesture | None
    """What it was taught, for any robot; None if it was not tapped."""


def guide(
    name: str, seed: int, *, repeat: bool = True, capability: tci.Capability[Any] | None = None,
    slow: float | None = None,
) -> Outcome | None:  # fmt: skip
    """A hand guides an arm at a random place; then the other arm is tapped, or one that stands alone, twice.
    The loop's rate is drawn, unless it is `slow` [Hz]. None if the arm can't go at 0.2 m/s there, unless the
    robot stopped: then all of the push counts."""
    random, robot = np.random.default_rng(seed), tci.load_robot(name)
    if slow is not None:
        binding = robot.binding("sim").model_copy(update={"stale_after": PATIENT})
        robot = robot.model_copy(update={"bindings": (binding,), "digest": f"{name} {slow}"})
    arms = [one.name for one in robot.parts if one.kind == "arm"]
    part = str(random.choice(arms))
    other = next((one for one in arms if one != part), part)
    start = np.deg2rad(random.uniform([0, 15, -20, 40, -20], [50, 50, 20, 90, 20]))
    angles = angles_of(robot, part, start)
    rate = float(random.choice([100.0, 500.0]))
    rate = slow or rate
    pad = float(np.exp(random.uniform(np.log(800.0), np.log(2000.0))))
    plant = GuidedRobot(
        robot, people=[Person("hand", pad, radius=RADIUS), Person("finger", 1500.0, radius=RADIUS)],
        seed=seed, angles=angles, rate=rate,
    )  # fmt: skip
    link, patch, p_L, n_L = place_on(plant, part, random)
    hand = Guide(
        plant, "hand", link, p_L, n_L, random.uniform(0.4, 0.8), random.uniform(200.0, 800.0),
        random.uniform(0.5, 1.0), pad,
    )  # fmt: skip
    if not _can_go(plant, part, hand):
        return None
    tap_link, _, tap_p, tap_n = place_on(plant, other, random)
    tap = Tap(plant, "finger", tap_link, tap_p, tap_n, ())
    plant.hands = hand, tap
    joints = joint_map(robot, part)
    limits = [robot.servos[k].limits for k in joints.servos]
    low = np.array([-np.inf if one.lower is None else one.lower for one in limits]) + FREE
    high = np.array([np.inf if one.upper is None else one.upper for one in limits]) - FREE
    path: list[tuple[float, Array]] = []
    ended: list[tuple[float, str]] = []

    def see(tick: Any) -> None:
        angles = plant.position
        path.append((plant.time, joints.to_generic(angles)))
        own = angles[joints.servos]
        if hand.first is None or plant.time > hand.first + hand.lasts:
            return
        if not ((own > low) & (own < high)).all() and not ended:
            ended.append((plant.time, "a joint's limit"))
        for one in tick.sent.clamped:
            if not ended:
                ended.append(
                    (plant.time, "its own body" if "would come" in str(one) else "the gate's limits")
                )
        after = hand.first + hand.lasts + 0.6
        tap.times = (after,) if other != part else (after, after + 0.3)

    lasts = 0.6 + GUIDES + 0.2 + ((0.6 + 0.7 + BACK + GUIDES + 0.5) if repeat else 0.0)
    result = run(RigidDriver(plant), capability or tci.Teach(), duration=lasts, observe=see)
    if hand.first is None or hand.elsewhere:
        return None
    times, forces = hand.force
    stopped = result.state.name == "STOP"
    until = ended[0][0] - hand.first if ended and not stopped else hand.lasts
    measured = forces[(times >= MEASURED) & (times <= until)]
    if len(measured) < 0.2 / STEP and not stopped:
        return None
    taught = [(t, a) for t, a in path if hand.first <= t <= hand.first + hand.lasts + 0.1]
    later = [(t, a) for t, a in path if tap.times and t > tap.times[0] + 0.3]
    apart, led, repeated = off(taught, later)
    motion = getattr(result.memory, "motion", None)
    gesture = None if motion is None else motion.gesture(tci.GenericBody(robot))
    return Outcome(
        name, patch, rate, pad, min(until, hand.lasts) - MEASURED, float(np.median(measured)),
        float(np.percentile(measured, 95)), float((measured > 0.1).mean()),
        float(forces[(times >= 0.0) & (times <= until)].max()), tap.felt, apart, result.state.name,
        ended[0][1] if ended else "", (times, forces), led, repeated, gesture,
    )  # fmt: skip


def place_on(plant: GuidedRobot, part: str, random: np.random.Generator) -> tuple[str, str, Array, Array]:
    """Link, patch, point and normal in the link's frame of a random taxel of an arm, or of what it carries,
    that lies on the link: sleeves of some robots reach over other links, where this plant feels nothing."""
    robot, angles = plant.robot, plant.position
    side = robot.part(part).side
    patches = [one for one in robot.skin if one.part == part and one.segment] or [
        one
        for one in robot.skin
        if robot.part(one.part).kind in ("hand", "fingers") and robot.part(one.part).side == side
    ]
    skin, chain = Skin(robot), KinematicChain(robot)
    while True:
        patch = patches[int(random.integers(len(patches)))]
        positions, normals = skin_at(skin, patch.name, angles)
        taxel = int(random.integers(len(positions)))
        T_TL = chain.poses(angles, [patch.link])[patch.link]
        back = T_TL[:3, :3].T
        p_L, n_L = back @ (positions[taxel] - T_TL[:3, 3]), back @ normals[taxel]
        if abs(plant.height(patch.link, p_L, n_L) - RADIUS) < ON_LINK:
            return patch.link, patch.name, p_L, n_L


def _can_go(plant: GuidedRobot, part: str, hand: Guide) -> bool:
    """The least joint speeds that move the place at the hand's speed are within 60 % of the servos', and the
    place is `LEAST` away from the axes."""
    robot, joints = plant.robot, joint_map(plant.robot, part)
    chain = KinematicChain(robot)
    columns = chain.jacobian(plant.position, hand.link, point=hand.p_L)[:3, joints.servos]
    T_TL = chain.poses(plant.position, [hand.link])[hand.link]
    push = columns.T @ -(T_TL[:3, :3] @ hand.n_L)
    speeds = np.abs(push) * hand.speed / max(float(push @ push), 1e-9)
    most = np.array([robot.servos[k].limits.velocity or np.inf for k in joints.servos])
    return bool((speeds < 0.6 * most).all()) and float(np.linalg.norm(push)) >= LEAST


def ends_with_a_tap(name: str, number: int) -> bool | None:
    """A drawn person holds the left arm, then taps the right one, without physics: true if that, and nothing
    before, ends the lesson. None if the skin did not feel the hold for a second: iCub's has wide gaps."""
    robot, teach = TouchedRobot(name), tci.Teach()
    persons = {"p": Toucher.drawn(f"teacher {number}", seed=7)}
    touches = ["hold 'left forearm' 8N 1.5s @0.3s by p", "tap 'right forearm' @2.8s by p"]
    memory, held = teach.init(robot.body), 0
    waits = (robot.perceive() for _ in range(40))
    for seen in chain(robot.feel(touches, persons=persons, seed=number), waits):
        _, memory = teach.step(memory, seen, robot.body)
        held += any(one.part == "left_arm" for one in seen.contacts)
        if memory.motion is not None:
            return seen.stamp > 2.8
    return False if held * PERIOD > 1.0 else None


def hands_apart(gesture: Gesture, one: str, other: str) -> float:
    """Largest angle [deg] between the directions from the shoulder to the hand of two robots that play a
    gesture, at the same moments of it."""
    first, second = (_directions(gesture, name) for name in (one, other))
    return max(
        float(np.degrees(np.arccos(np.clip((first[part] * second[part]).sum(axis=1), -1.0, 1.0)).max()))
        for part in gesture.postures
    )


def _directions(gesture: Gesture, name: str) -> dict[str, Array]:
    """Unit vectors (20, 3) in the torso frame, by arm."""
    robot, found = tci.load_robot(name), dict[str, Array]()
    fitted, skin = fit(robot, gesture).gesture, Skin(robot)
    for part in gesture.postures:
        tip, ways = np.array([0.0, 0.0, -robot.part(part).segment("forearm").length, 1.0]), []
        for time in np.linspace(0.0, fitted.duration, 20):
            angles = fitted.at(float(time))[part]
            position = np.array(initial_position(robot))
            joints = joint_map(robot, part)
            position[joints.servos] = joints.to_robot(angles, position)
            reading = JointReading(0.0, 0, read_only(position), read_only(np.zeros(len(position))))
            shoulder = skin.segment_pose(part, "upper_arm", reading, angles)[:3, 3]
            way = (skin.segment_pose(part, "forearm", reading, angles) @ tip)[:3] - shoulder
            ways.append(way / np.linalg.norm(way))
        found[part] = np.array(ways)
    return found


Path = tuple[Array, Array]


def off(taught: list[tuple[float, Array]], later: list[tuple[float, Array]]) -> tuple[float, Path, Path]:
    """Angle [deg], r.m.s., between the taught path and the part of the later one that fits best; and both."""
    times, path = np.array([t for t, _ in taught]), np.array([a for _, a in taught])
    seen, found = np.array([t for t, _ in later]), np.array([a for _, a in later])
    times = times - times[0]
    best, at = np.inf, path
    begins = np.arange(seen[0], max(seen[-1] - times[-1], seen[0]) + 1e-9, 0.02) if len(seen) else ()
    for begin in begins:
        there = np.column_stack([np.interp(times + begin, seen, column) for column in found.T])
        apart = float(np.sqrt(((there - path) ** 2).mean(axis=0)).max())
        if apart < best:
            best, at = apart, there
    return float(np.degrees(best)), (times, path), (times, at)
