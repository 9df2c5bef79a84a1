"""Trials in which a moving arm meets somebody who can't give way."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from helpers.rigid_robot import Dirt, Felt, Person, RigidDriver, RigidRobot
from helpers.taught import RADIUS as FINGER
from helpers.taught import GuidedRobot, Tap, place_on
from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.play_gesture import PlayGesture
from tci.capabilities.teach.capability import Teach
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import CommandError
from tci.gestures.gesture import Fitted, Gesture
from tci.messages import GenericCommand, Mode, Order, Perception, SwitchMode
from tci.messages.frames import Array
from tci.reasons import Code
from tci.robot.description import Robot
from tci.runtime.loop import run

By = Literal["order", "gesture", "lesson", "reflex"]
"""Who moves the arm: a lesson is played after a tap on the other arm, a reflex answers one on its own."""
STARTS = 1.0
"""Time [s] until a lesson is played: a tap, and the end of its series."""
LASTS, AFTER, RESET = 3.4, 2.02, 0.5
"""Least length [s] of a trial, and of the contact with each person in it: 2 s after its start is judged. Then
the gate is reset, and what is left after that is judged, too."""
SWAYS, BY = 2.5, 0.15
"""Time [s] for which an arm behind a wire sways at first, and by which angle [rad]: until then a gate knows
nothing of its torques."""
POKED = (2e-3, 8e-3)
"""Depth [m] of a tap that an arm withdraws from: 3 to 12 N."""


@dataclass(frozen=True)
class Squeeze:
    """What one trial draws."""

    part: str
    start: Array
    goal: Array
    """Generic angles (n,) [rad] of the part."""
    mode: Mode
    share: float
    """Of the gate's full speed."""
    stiffness: float
    """[N/m]."""
    link: str
    point: Array
    """(3,) [m] in the link's frame: where the robot strikes."""
    at: Array
    """(3,) [m] in the world: the middle of the person's surface, a sphere."""
    rate: float
    """Of readings and commands [Hz]."""
    seed: int
    by: By = "order"
    stops: float | None = None
    """Time [s] after the first contact at which the gate is stopped for another cause."""


@dataclass(frozen=True)
class Pressed:
    """What one person bore."""

    first: float | None
    """Time of the first contact [s]."""
    peak: float
    half: float
    """Force [N] 0.5 s after the first contact."""
    late: float
    """Force [N] 2 s after."""
    reset: float
    """Force [N] at the end, after somebody reset the gate."""
    over: float
    """Time above 65 N [s]."""
    felt: bool
    """They were on skin."""


@dataclass(frozen=True)
class Outcome(Pressed):
    state: str
    said: tuple[str, ...]
    other: Pressed
    """Whoever stands behind."""
    force: tuple[Array, Array]
    """Times [s] and forces [N] on the first person."""


class Cut(RigidDriver):
    """Its link is cut after the first order of an answer to somebody."""

    cut = False

    def _send(self, safe: Any) -> None:
        if not self.cut:
            super()._send(safe)
        self.cut |= any(reason.code is Code.CONTACT for reason in safe.clamped)


class Reach(Capability[bool]):
    """Moves one part to a posture, once, in any mode."""

    def __init__(self, trial: Squeeze) -> None:
        self.trial = trial

    def init(self, body: GenericBody) -> bool:
        return False

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Order, ...]:
        return (SwitchMode(self.trial.part, self.trial.mode),)

    def step(self, memory: bool, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], bool]:
        one = self.trial
        if one.mode is Mode.VELOCITY:
            way = one.goal - perception.posture[one.part]
            speed = np.clip(4.0 * way, -one.share * 3.0, one.share * 3.0)
            return (GenericCommand(one.part, Mode.VELOCITY, speed),), True
        return (() if memory else (GenericCommand(one.part, one.mode, one.goal),)), True


class Sway(Capability[None]):
    """Moves the joints of one part to and fro."""

    def __init__(self, trial: Squeeze) -> None:
        self.trial = trial

    def init(self, body: GenericBody) -> None:
        pass

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[Order, ...], None]:
        goal = self.trial.start + BY * np.sin(4.0 * np.pi * perception.stamp / SWAYS)
        return (GenericCommand(self.trial.part, Mode.POSITION, goal),), None


def moved_by(one: Squeeze) -> Capability[Any]:
    """What moves the arm."""
    if one.by == "order":
        return Reach(one)
    if one.by == "reflex":
        full = WithdrawalReflex(mode=one.mode, people=())
        return full if one.share == 1.0 else WithdrawalReflex(mode=one.mode)
    way = float(np.abs(one.goal - one.start).max())
    gesture = Gesture(np.array([0.0, way / (3.0 * one.share)]), {one.part: np.array([one.start, one.goal])})
    if one.by == "lesson":
        return Teach(gesture=gesture)
    return PlayGesture(Fitted(gesture, gesture, 1.0, {}, ()))


def squeeze(
    robot: Robot,
    one: Squeeze,
    *,
    settings: Any = None,
    dirt: Dirt | None = None,
    behind: float | None = None,
    cut: bool = False,
    sways: bool = False,
) -> Outcome:
    """Runs a trial. A second person, as stiff, steps `behind` [m] behind the link when the first is met; or
    the link to the robot is `cut` when the gate answers. If it `sways`, the arm moves without anybody
    first."""
    begins = SWAYS if sways else 0.0
    plant = plant_of(robot, one, dirt, begins=begins)
    driver = (Cut if cut else RigidDriver)(plant, settings=settings)
    if sways:
        run(driver, Sway(one), duration=SWAYS)
    plant.place("person", one.at)
    person, second = (plant.felt[name] for name in ("person", "second"))
    skin = {"person": False, "second": False}
    there, state, reason = False, "", None

    def see(tick: Any) -> None:
        nonlocal there
        for name in skin:
            skin[name] = skin[name] or (plant.felt[name].now > 1.0 and plant.on_skin(name))
        if person.first is None:
            return
        if behind is not None and not there:
            there = True
            plant.place("second", _behind(robot, plant, one, behind))
        if one.stops is not None and plant.time >= person.first + one.stops:
            driver.gate.stop("another cause")

    least = LASTS + (STARTS if one.by == "lesson" else 0.0)

    def over(_: Any) -> bool:
        nonlocal state, reason
        last = max(begins + least, max(felt.first or 0.0 for felt in (person, second)) + AFTER)
        if plant.time >= last and not state:
            state, reason = driver.gate.state.name, driver.gate.reason
            with suppress(CommandError):  # somebody is still held
                driver.gate.reset()
        return plant.time >= last + RESET

    result = run(driver, moved_by(one), duration=2.0 * least, observe=see, until=over)
    said = [str(notice) for notice in (*result.refusals, *result.clamps, *result.holds, *result.went_back)]
    said += [str(reason)] if reason else []
    return Outcome(
        **vars(pressed(person, skin["person"])), state=state, said=tuple(said),
        other=pressed(second, skin["second"]), force=(np.array(person.time), np.array(person.force)),
    )  # fmt: skip


def pressed(force: Felt, felt: bool) -> Pressed:
    """What somebody bore, on skin if it `felt` them."""
    first = force.first
    half, late = (0.0 if first is None else force.at(first + after) for after in (0.5, 2.0))
    return Pressed(first, force.peak, half, late, force.now, force.above(65.0), felt)


def _behind(robot: Robot, plant: RigidRobot, one: Squeeze, room: float) -> Array:
    """Place of the second person's middle: on the far side of the link that meets the first, with `room` [m]
    to every solid of the part, and clear of all others."""
    part = links_of(robot, plant, one.part)
    position, rotation = plant.link_pose(one.link)
    world = position + vertices_of(plant, one.link) @ rotation.T
    ahead = one.at - (position + rotation @ one.point)
    ahead /= np.linalg.norm(ahead)
    place: Array = one.at.copy()
    while ((world - place) @ ahead < 0.0).all() or any(
        gap < (room if link in part else 0.0) for link, gap in plant.gaps("second", place).items()
    ):
        place -= 1e-3 * ahead
    return place


def angles_of(robot: Robot, part: str, posture: Array) -> Array:
    """Angles (n_servos,) [rad] with a part in a posture (n,) [rad], and all others as they begin."""
    from tci.body.posture import to_platform
    from tci.robot.joint_map import initial_position

    angles = np.array(initial_position(robot))
    own = to_platform(robot, GenericCommand(part, Mode.POSITION, posture), position=angles)
    low = np.array([-np.inf if (x := robot.servos[s].limits.lower) is None else x for s in own.servos])
    high = np.array([np.inf if (x := robot.servos[s].limits.upper) is None else x for s in own.servos])
    angles[own.servos] = np.clip(own.values, low + 1e-3, high - 1e-3)
    return angles


def plant_of(robot: Robot, one: Squeeze, dirt: Dirt | None = None, *, begins: float = 0.0) -> RigidRobot:
    """The plant where a trial starts, its people out of reach. The trial `begins` [s] later."""
    angles = angles_of(robot, one.part, one.start)
    people = [Person(name, one.stiffness) for name in ("person", "second")]
    if one.by in ("order", "gesture"):
        return RigidRobot(robot, people=people, dirt=dirt, seed=one.seed, angles=angles, rate=one.rate)
    plant = GuidedRobot(
        robot, people=[Person("finger", 1500.0, radius=FINGER), *people], dirt=dirt, seed=one.seed,
        angles=angles, rate=one.rate,
    )  # fmt: skip
    random = np.random.default_rng(one.seed)
    other = next(part.name for part in robot.parts if part.kind == "arm" and part.name != one.part)
    link, _, p_L, n_L = place_on(plant, one.part if one.by == "reflex" else other, random)
    deep = float(random.uniform(*POKED)) if one.by == "reflex" else Tap.depth
    plant.hands = (Tap(plant, "finger", link, p_L, n_L, (begins + 0.1,), depth=deep),)
    return plant


def links_of(robot: Robot, plant: RigidRobot, part: str, least: int = 2) -> list[str]:
    """Links with a solid that at least so many of the part's joints move."""
    joints = {robot.servos[one.servo].joint for one in robot.part(part).servos if one.servo is not None}
    model, found = plant.model, []
    for body in plant._own:
        if not model.body_geomnum[body]:
            continue
        moved, up = 0, body
        while up:
            for joint in range(model.body_jntadr[up], model.body_jntadr[up] + model.body_jntnum[up]):
                moved += model.joint(joint).name in joints
            up = model.body_parentid[up]
        if moved >= least:
            found.append(model.body(body).name)
    return found


def vertices_of(plant: RigidRobot, link: str) -> Array:
    """Points (n, 3) [m] on a link's solids, in its frame."""
    model, found = plant.model, []
    body = model.body(link).id
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            adr, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            points = model.mesh_vert[adr : adr + count]
        else:
            random = np.random.default_rng(0).normal(size=(64, 3))
            points = model.geom_aabb[geom, 3:] * random / np.abs(random).max(axis=1, keepdims=True)
        found.append(model.geom_pos[geom] + points @ rotation.reshape(3, 3).T)
    return np.concatenate(found)
