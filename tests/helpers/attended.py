"""Judge of `tci.Attend`: MuJoCo's pose of the head, a finger, and where the cameras are.

Nothing of `tci.body.gaze` or the capability is used. Where a robot's cameras are, and which way they look, is
the judge's own table, from the makers' papers and models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import mujoco
import numpy as np

import tci
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.messages.frames import Array
from tci.robot.description import Patch
from tci.simulation.world import World


@dataclass(frozen=True)
class Camera:
    body: str
    xyz: tuple[float, float, float]
    """[m], in the body's frame."""
    ahead: tuple[float, float, float]
    """Direction of the gaze with a straight neck, in the body's frame."""
    joints: tuple[tuple[str, float], ...]
    """What turns the gaze, and the robot's own limit [rad/s], or the description's if that is less."""
    level: bool = False
    """Only the bearing counts, since only the waist turns."""


CAMERAS = {
    "nao": Camera("Head", (0.05871, 0.0, 0.06364), (1, 0, 0), (("HeadYaw", 5.2), ("HeadPitch", 5.2))),
    "icub": Camera("head", (0.0, 0.1044, 0.0509), (0, 0, 1), (("neck_yaw", 1.745), ("neck_pitch", 1.745))),
    "g1": Camera("torso_link", (0.058, 0.018, 0.43), (1, 0, 0), (("waist_yaw_joint", 3.14),), level=True),
    "talos": Camera("rgbd_link", (0, 0, 0), (1, 0, 0), (("head_2_joint", 1.0), ("head_1_joint", 1.0))),
    "alex": Camera("Head", (0.14, -0.01, 0.015), (1, 0, 0), (("NeckYaw", 3.14), ("NeckPitch", 3.14))),
}


def camera_of(robot: str) -> Camera:
    return CAMERAS[robot.split("-")[0]]


@dataclass(frozen=True)
class Seen:
    """One touch, as the judge saw it."""

    patch: str
    turned: float
    """Angle [deg] between gaze and finger when the arm had withdrawn and nothing kept the gaze."""
    late: float
    """Time [s] by which the gaze came after its deadline; negative if it came before."""
    off: float
    """Angle [deg] between gaze and place within which it stayed for half a second, by the deadline."""
    best: float
    """Least angle [deg] that any angles of the joints leave: above 4 if the place is out of reach."""
    withdrew: bool
    kept: str
    """Why the gaze stayed away, or came late, if it was told: the gate stopped the way before a collision, a
    turn of the waist would have brought the arm back to the finger, or the arm met its own body."""
    notes: tuple[str, ...]

    @property
    def met(self) -> bool:
        """Gaze within 5 degrees of the place, or of as near as the joints go, by its deadline, and for half a
        second: an arm may withdraw so slowly that the gaze has come, and left, before the arm rests."""
        return bool(self.kept) or self.off <= self.best + 5.0


class Judge:
    """Where a simulated robot looks."""

    def __init__(self, world: World, camera: Camera) -> None:
        self.world, self.camera = world, camera
        self.model, self.scratch = world.model, mujoco.MjData(world.model)

    def off(self, place: Array, data: Any = None) -> float:
        """Angle [deg] between gaze and `place` (3,) in the world."""
        if data is None:
            data = self.scratch
            data.qpos[:] = self.world.data.qpos
            mujoco.mj_kinematics(self.model, data)
        body, camera = data.body(self.camera.body), self.camera
        R = body.xmat.reshape(3, 3)
        gaze, way = R @ np.array(camera.ahead, float), place - (body.xpos + R @ np.array(camera.xyz))
        if camera.level:
            gaze[2] = way[2] = 0.0
        cosine = gaze @ way / (np.linalg.norm(gaze) * np.linalg.norm(way))
        return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))

    def best(self, place: Array) -> float:
        """Least angle [deg] that any angles of the joints leave."""
        names = [name for name, _ in self.camera.joints]
        data = self.scratch
        data.qpos[:] = self.world.data.qpos
        ranges = [np.linspace(*self._range(name), 61 if len(names) > 1 else 361) for name in names]
        least = 180.0
        for angles in product(*ranges):
            for name, angle in zip(names, angles, strict=True):
                data.joint(name).qpos[0] = angle
            mujoco.mj_kinematics(self.model, data)
            least = min(least, self.off(place, data))
        return least

    def _range(self, joint: str) -> tuple[float, float]:
        limits = next(one.limits for one in self.world.robot.servos if one.joint == joint)
        assert limits.lower is not None
        assert limits.upper is not None
        return limits.lower, limits.upper


CAPABILITY = tci.Arbiter([tci.WithdrawalReflex(), tci.Attend()])
STOPS = 0.1
"""Speed [rad/s] below which an arm has withdrawn."""
LASTS = 4.5
"""Length of a trial [s]: a slow withdrawal, a slow neck, and a second of looking."""
HALF = 0.5
"""Time [s] for which the gaze must stay."""
WAITS = 1.0
"""Time [s] by which the gaze may be late if it is told that it waits: the gate holds a neck back until half a
second after an arm's contact."""
FRAME = 0.02
"""Period [s] of a skin: a finger that glances off within it touched nothing."""


def posture(robot: tci.Robot, random: np.random.Generator) -> dict[str, Array]:
    """Arms anywhere before the body, where a neck can see them."""
    lower, upper = np.deg2rad([20, 5, -20, 50, -20]), np.deg2rad([80, 45, 30, 100, 20])
    return {part.name: random.uniform(lower, upper) for part in robot.parts if part.kind == "arm"}


def touch(name: str, seed: int) -> Seen | None:
    """Pokes a random taxel of a random patch; None if there is no room for the finger."""
    random, robot, camera = np.random.default_rng(seed), tci.load_robot(name), camera_of(name)
    patches = [one for one in robot.skin if robot.part(one.part).kind != "head" and one.segment != "foot"]
    patch = patches[int(random.integers(len(patches)))]
    # the skin of one patch is enough, and quicker
    world = World(robot, posture=posture(robot, random))
    taxel = int(random.integers(len(world.surfaces[patch.name].positions)))
    try:
        world.finger.poke(patch.name, taxel, depth=float(random.uniform(0.003, 0.01)), gap=0.05)
    except TciError:
        return None
    judge, trace, speeds, notes = Judge(world, camera), [], [], dict[str, None]()
    own = {name for name, _ in camera.joints}
    arms = [
        world.model.joint(one.joint).dofadr[0] for one in robot.servos if one.joint and one.joint not in own
    ]
    place: list[Array] = []

    def see(tick: tci.Tick) -> None:
        finger = world.finger
        if camera.level and finger.first_contact is not None and tick.now > finger.first_contact + 0.8:
            finger.retire()
        if finger.touching and finger.pose is not None:
            place[:] = [finger.pose[:3, 3].copy()]
        qpos, touching = world.data.qpos.copy(), finger.touching
        trace.append((tick.now, touching, float(np.abs(world.data.qvel[arms]).max()), qpos))
        speeds.extend(
            float(np.min(one.speed))
            for one in tick.commands
            if one.part in ("head", "torso") and getattr(one, "speed", None) is not None
        )

    def listen(memory: Any) -> bool:
        notes.update(dict.fromkeys(CAPABILITY.notes(memory)))
        return False

    result = tci.run(
        SimulatedDriver(robot, world=world), CAPABILITY, duration=LASTS, observe=see, until=listen
    )
    times = np.array([row[0] for row in trace])
    if sum(row[1] for row in trace) * (times[1] - times[0]) < FRAME:
        return None
    touching, moving = np.array([row[1] for row in trace]), np.array([row[2] for row in trace])
    onset = int(np.argmax(touching))
    end = onset
    there = [world.model.jnt_qposadr[world.model.dof_jntid[dof]] for dof in arms]
    withdrew = bool(np.abs(trace[-1][3][there] - trace[onset][3][there]).max() > np.deg2rad(2.0))
    if withdrew:
        end += int(moving[onset : int(np.searchsorted(times, times[onset] + 0.4))].argmax())
        while moving[end : int(np.searchsorted(times, times[end] + 0.05))].max() > STOPS:
            end += 1
    if camera.level:  # nobody touches what the waist would move
        end = max(end, int(np.flatnonzero(touching)[-1]))
    offs = [_off(judge, qpos, place[0]) for *_, qpos in trace]
    limit = min([*(speed for _, speed in camera.joints), *speeds])
    waits = 0.7 if camera.level else 0.3  # half a second after a touch of what a waist would move
    deadline = times[end] + waits + np.radians(offs[end]) / (0.8 * limit)
    best = judge.best(place[0])
    stays = round(HALF / (times[1] - times[0]))
    held = np.array([max(offs[k : k + stays]) for k in range(len(times) - stays)])
    came = onset + np.flatnonzero(held[onset:] <= best + 5.0)
    late = float(times[came[0]] - deadline) if len(came) else np.inf
    off = float(held[onset : int(np.searchsorted(times, deadline)) + 1].min())
    kept = "a collision" if any("would come" in str(one) for one in result.clamps) else ""
    if late <= WAITS and any("head waits" in str(one) for one in result.went_back):
        kept = "the arm"
    if camera.level and offs[-1] > 5.0 and any("back to the hand" in note for note in notes):
        kept = "the finger"
    return Seen(
        patch.name, offs[end], late, off, best, withdrew, kept, tuple(notes),
    )  # fmt: skip


def _off(judge: Judge, qpos: Array, place: Array) -> float:
    judge.scratch.qpos[:] = qpos
    mujoco.mj_kinematics(judge.model, judge.scratch)
    return judge.off(place, judge.scratch)


@dataclass(frozen=True)
class Followed:
    """A stroke, as the judge saw it."""

    worst: float
    """Largest angle [deg] between gaze and hand once the gaze had come, beyond what no joints reach."""
    turned: float
    """Angle [deg] by which the hand's direction changed in that time, as the eyes see it."""
    lasted: float
    """[s]"""


def stroke(name: str, words: str, *, posture: dict[str, Array] | None = None) -> Followed | None:
    """Strokes an arm without a reflex. None if the hand is never there for long enough."""
    robot, camera, capability = tci.load_robot(name), camera_of(name), tci.Attend()
    world = World(robot, posture=posture or {}, people=1)
    planned = world.touch(words)
    judge, rows = Judge(world, camera), []
    hand = {
        geom for geom in range(world.model.ngeom)
        if "person1" in world.model.body(world.model.geom_bodyid[geom]).name
    }  # fmt: skip

    def see(tick: tci.Tick) -> None:
        data, points, forces = world.data, [], []
        for k, contact in enumerate(data.contact[: data.ncon]):
            if hand & {*contact.geom.tolist()}:
                wrench = np.zeros(6)
                mujoco.mj_contactForce(world.model, data, k, wrench)
                points.append(contact.pos.copy())
                forces.append(abs(wrench[0]) + 1e-9)
        if sum(forces) > 0.5:
            rows.append((tick.now, np.average(points, axis=0, weights=forces), data.qpos.copy()))

    lasts = max(one.end for one in planned) + 0.6
    tci.run(SimulatedDriver(robot, world=world), capability, duration=lasts, observe=see)
    limit = min(speed for _, speed in camera.joints)
    later: list[tuple[float, Array, Array]] = []
    before, deadline = -np.inf, np.inf
    for row in rows:
        if row[0] - before > 0.05:  # a hand that was lifted comes down elsewhere: a touch of its own
            deadline = row[0] + 0.3 + np.radians(_off(judge, row[2], row[1])) / (0.8 * limit)
        before = row[0]
        if row[0] >= deadline and (not later or row[0] - later[-1][0] >= 0.02):
            later.append(row)
    if not later:
        return None
    worst = 0.0
    for _, place, qpos in later:
        off = _off(judge, qpos, place)
        if off > 10.0:
            judge.world.data.qpos[:] = qpos
            off = max(off - judge.best(place), 0.0)
        worst = max(worst, off)
    judge.scratch.qpos[:] = later[0][2]
    mujoco.mj_kinematics(judge.model, judge.scratch)
    body = judge.scratch.body(camera.body)
    eye = body.xpos + body.xmat.reshape(3, 3) @ np.array(camera.xyz)
    ways = np.array([place - eye for _, place, _ in later])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    turned = float(np.degrees(np.arccos(np.clip(ways @ ways[0], -1.0, 1.0))).max())
    return Followed(worst, turned, later[-1][0] - later[0][0])


class Still(tci.Capability[None]):
    """Moves nothing."""

    def init(self, body: tci.GenericBody) -> None:
        return None

    def step(self, memory: None, perception: tci.Perception, body: tci.GenericBody) -> tuple[tuple[()], None]:
        return (), None


def two_people(name: str, seed: int, capability: tci.Capability[Any]) -> dict[str, float] | None:
    """The largest force [N] of each hand of which one presses or holds what turning the gaze would move, and
    another touches a random place. None if a hand has no room."""
    random, robot = np.random.default_rng(seed), tci.load_robot(name)
    heads = [one for one in robot.skin if robot.part(one.part).kind == "head"]
    first = f"{random.choice(['press', 'hold'])} {_anywhere(robot, heads or robot.skin, random)} @0.3s 3s"
    second = f"{random.choice(['poke', 'press', 'push'])} {_anywhere(robot, robot.skin, random)}"
    world = World(robot, posture=posture(robot, random), people=2)
    try:
        world.touch([first, f"{second} @{random.uniform(0.6, 1.5):.2f}s"], seed=seed)
    except TciError:
        return None
    hands = {f"{one.name} {hand}": getattr(one, hand) for one in world.people for hand in ("left", "right")}
    most = dict.fromkeys(hands, 0.0)

    def see(tick: tci.Tick) -> None:
        most.update({name: max(most[name], hand.force) for name, hand in hands.items()})

    tci.run(SimulatedDriver(robot, world=world), capability, duration=3.2, observe=see)
    return most


def _anywhere(robot: tci.Robot, patches: Sequence[Patch], random: np.random.Generator) -> str:
    patch = patches[int(random.integers(len(patches)))]
    taxel = int(random.integers(patch.channels))
    return f"'{patch.name} taxel {taxel}' {random.uniform(2.0, 12.0):.1f}N"
