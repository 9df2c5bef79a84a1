"""Judge of touch words: hands, tables, chests, sleeves and the robot itself touch it in the physics.

It knows what each of them was to do, when the skin was last touched, and what the robot said. Of the
capability it uses only the words. The people are drawn here, apart from those who trained it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

import tci
from tci.body.perceiver import Perceiver
from tci.capabilities import TouchWord, TouchWords
from tci.messages import JointReading, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import initial_position
from tci.simulation.obstacle import Obstacle
from tci.simulation.world import World
from tci.skin.layout import normal_channels
from tci.touches.person import Person
from tci.touches.planned_touch import plan

WORDS = (
    "poke", "tap", "pat", "hit", "press", "stroke", "rub", "scratch", "tickle", "squeeze", "hold",
)  # fmt: skip
OTHERS = "table", "chest", "edge", "sleeve", "itself", "lean"
"""What touches a robot and means nothing: it meets a table, a person's chest or an edge, a sleeve lies on the
skin, its own arm does, somebody leans on it with the whole weight of an arm."""
ON_SKIN = 0.8
"""Fraction of the time for which the middle of a pad must be within 1 cm of a taxel: people rub and stroke
where there is room."""
SPREAD = 0.42
"""Of the logarithms of people's lengths and forces: two of three people differ by up to 2.3 times."""
HELD = 0.5
"""Fraction of the planned time for which the hand must press: one that slips off did something else."""
AFTER = 0.8
TRIES = 400
Told = tuple[float, TouchWord]
Seen = tuple[float, tci.Perception, tuple[TouchWord, ...]]


@dataclass(frozen=True)
class Outcome:
    robot: str
    true: str
    told: tuple[str, ...]
    """All words that were told of it; none if nothing was."""
    certainty: float
    late: float
    """Time [s] from the last contact to the word; NaN without a word."""
    force: float
    """Largest force [N] on the skin in the physics; NaN where pressure was laid."""
    slowest: float
    """Processor time [s] of the slowest step of the capability."""
    bare: bool = False
    """Of a grip: the pads on the other side met no skin."""
    note: str = ""

    @property
    def word(self) -> str:
        """What it was taken for: one wrong word among several counts."""
        wrong = [word for word in self.told if word != self.true]
        if self.true == "other":
            return wrong[0] if wrong else "other"
        return wrong[0] if wrong else self.true if self.told else "nothing"


def judge(name: str, true: str, seed: int, *, faults: bool = False, recogniser: str = "") -> Outcome:
    """One trial. If there is no room for a hand or a thing somewhere, it tries elsewhere."""
    random = np.random.default_rng([seed, sum(map(ord, true)), 77])
    listener = TouchWords(recogniser)
    for _ in range(TRIES):
        if true in WORDS or true == "lean":
            found = _person(name, true, random, faults, listener)
        elif true == "sleeve":
            found = _sleeve(name, random, faults, listener)
        else:
            found = _met(name, true, random, faults, listener)
        if found is not None:
            return found
    raise AssertionError(f"{name}: no room for {true} at {TRIES} places")


# ---------------------------------------------------------------------- people


def _person(
    name: str, true: str, random: np.random.Generator, faults: bool, listener: TouchWords
) -> Outcome | None:
    world = _hand_world(name)
    world.reset()
    pace, force = np.exp(random.normal(0.0, SPREAD, 2)).tolist()
    person = Person("judged", pace, force, float(np.exp(random.normal(0.0, 0.12))),
                    float(np.exp(random.normal(0.0, SPREAD))), 0.5)  # fmt: skip
    grips, body = true in ("squeeze", "hold"), tci.GenericBody(world.robot)
    for _ in range(20):
        patch = str(random.choice(_patches(name, grips)))
        positions = world.surfaces[patch].positions
        taxel = int(random.integers(len(positions)))
        touch = tci.Touch(true, f"{patch} taxel {taxel}", 0.4, person="judged")
        if true == "lean":
            touch = tci.Touch("press", touch.place, 0.4, duration=random.uniform(5.0, 11.0),
                              force=random.uniform(50.0, 100.0))  # fmt: skip
        (planned,) = plan(body, touch, persons={"judged": person}, joints=world.joints(),
                          seed=int(random.integers(2**31)))  # fmt: skip
        pressed = planned.centre[planned.force > 0.0][::4] if not grips else planned.centre[:1, 0]
        near = np.array([np.linalg.norm(positions - at, axis=1).min() < 0.01 for at in pressed])
        if near.mean() >= ON_SKIN:
            break
    else:
        return None
    world.touch_as_planned([planned])
    there = planned.centre[len(planned.times) // 2]
    bare = bool(np.max([np.linalg.norm(positions - pad, axis=1).min() for pad in there]) > 0.015)
    last, most, presses = -np.inf, 0.0, list[bool]()
    words: list[Told] = []
    for now, _, heard in _listen(name, world, random, faults, listener, planned.end + AFTER):
        words += [(now, one) for one in heard]
        hand = sum(one.force for one in world.person().hands)
        if hand > 0.02:
            last, most = now, max(most, hand)
        presses.append(hand > 0.02)
    asked = np.ptp(planned.times) * float((planned.force.max(axis=1) > 0.0).mean())
    if world.time * np.mean(presses) < HELD * asked:
        return None
    traces = [one.trace for one in world.person().hands if len(one.trace)]
    touched = [trace[trace[:, 2] > 0.02, 0] for trace in traces]
    last = max((float(times[-1]) for times in touched if len(times)), default=last)
    return _outcome(
        name, "other" if true == "lean" else true, words, last, most, _TOOK[0], bare and grips,
        f"{true} on {patch} taxel {taxel}, pace {pace:.2f}, force {force:.2f}",
    )  # fmt: skip


# ---------------------------------------------------------------------- things


def _met(
    name: str, true: str, random: np.random.Generator, faults: bool, listener: TouchWords
) -> Outcome | None:
    """The arm moves into a thing, stays there for a while, and goes back."""
    world = _thing_world(name)
    world.reset()
    for one in ("table", "chest", "edge"):
        world.obstacle(one).remove()
    robot = world.robot
    arms = [one for one in robot.parts if one.kind == "arm"]
    part = arms[int(random.integers(len(arms)))]
    home = np.array(initial_position(robot))
    servos = np.array([one.servo for one in part.servos if one.servo is not None])
    if true == "itself":
        goal = _at_itself(world, home, servos, random)
    else:
        patches = [one.name for one in robot.skin if one.part == part.name and one.segment]
        patch = str(random.choice(patches))
        taxel = int(random.integers(len(world.surfaces[patch].positions)))
        point, normal = world.skin_point(patch, taxel)
        link = robot.patch(patch).link
        local = world.surfaces[patch].positions[taxel]
        ways = _ways(name, link, local, home, servos)
        servo = int(np.abs(ways @ normal).argmax())
        if abs(float(ways[servo] @ normal)) < 0.05:
            return None
        gap = random.uniform(0.02, 0.05)
        force = float(np.exp(random.uniform(np.log(3.0), np.log(60.0))))
        obstacle = world.obstacle(true)
        size = {"table": 0.02, "chest": 0.12, "edge": 0.008}[true]
        across = np.cross(normal, random.normal(size=3))
        along = normal if true == "table" else across / np.linalg.norm(across)
        obstacle.place(point + (gap + size) * normal, along)
        if any(true in (one.first, one.second) for one in world.meetings()):
            return None  # a thing that begins inside the robot throws its arm away
        way = gap + force / obstacle.obstacle.stiffness + random.uniform(0.0, 0.001)
        goal = home.copy()
        goal[servos[servo]] += way / float(ways[servo] @ normal)
    speed = float(np.exp(random.uniform(np.log(0.15), np.log(2.0))))
    stay = float(np.exp(random.uniform(np.log(0.15), np.log(5.0))))
    travel = max(float(np.abs(goal - home).max()) / speed, 0.1)
    words: list[Told] = []
    begin, last, most = np.inf, -np.inf, 0.0
    end = 0.3 + 2.0 * travel + stay + AFTER

    def drive(now: float) -> None:
        share = np.clip(min((now - 0.3) / travel, (0.3 + 2.0 * travel + stay - now) / travel), 0.0, 1.0)
        share = 3.0 * share**2 - 2.0 * share**3
        world.set_position_targets(servos, (home + share * (goal - home))[servos])

    for now, perception, heard in _listen(name, world, random, faults, listener, end, drive):
        words += [(now, one) for one in heard]
        if len(perception.contacts):
            begin, last = min(begin, now), now
            most = max(most, max(one.force for one in perception.contacts))
    if not np.isfinite(begin):
        return None
    return _outcome(
        name, "other", words, last, most, _TOOK[0], False, f"{true} speed {speed:.2f} {stay:.1f} s"
    )


def _at_itself(world: World, home: Array, servos: Array, random: np.random.Generator) -> Array:
    """Servo angles at which an arm meets the robot's own body, if some are found."""
    for _ in range(30):
        goal = home.copy()
        for servo in servos.tolist():
            limits = world.robot.servos[servo].limits
            goal[servo] = random.uniform(limits.lower, limits.upper)
        world.show(goal)
        if world.meetings():
            break
    world.reset()
    return goal


def _ways(name: str, link: str, local: Array, home: Array, servos: Array) -> Array:
    """How a point of a link moves (n, 3) [m/rad] in the torso frame with each servo."""
    skin = tci.GenericBody(tci.load_robot(name)).skin

    def at(position: Array) -> Array:
        pose = skin.link_pose(link, JointReading(0.0, 0, read_only(position), read_only(np.zeros(len(home)))))
        return pose[:3, :3] @ local + pose[:3, 3]

    here = at(home)
    found = []
    for servo in servos.tolist():
        moved = home.copy()
        moved[servo] += 1e-4
        found.append((at(moved) - here) / 1e-4)
    return np.array(found)


def _sleeve(name: str, random: np.random.Generator, faults: bool, listener: TouchWords) -> Outcome | None:
    """A sleeve: light pressure of some folds, wide and uneven, that drift over the skin. The physics knows no
    cloth, so its pressure is laid."""
    robot = tci.load_robot(name)
    body = tci.GenericBody(robot)
    patch = robot.patch(str(random.choice(_patches(name, False))))
    surface = body.skin.surfaces[patch.name]
    middle = surface.positions.mean(axis=0)
    size = np.ptp(surface.positions, axis=0)
    count = int(random.integers(2, 6))
    width = random.uniform(0.02, 0.06, count)
    start = middle + random.uniform(-0.5, 0.5, (count, 3)) * size
    drift = random.normal(0.0, 0.02, (count, 3))
    top = np.exp(random.uniform(np.log(200.0), np.log(2000.0), count))
    rates, phases = random.uniform(0.1, 1.5, (2, count))
    length = float(np.exp(random.uniform(np.log(0.5), np.log(8.0))))
    home = np.array(initial_position(robot))
    rest = {one.name: np.full(one.channels, float(one.sensor.rest)) for one in robot.skin}
    gains, perceiver = _gains(name, random, faults), Perceiver(body)
    words: list[Told] = []
    memory, last, felt = listener.init(body), 0.0, False
    slowest = 0.0
    for number in range(int((length + 1.2) * 50)):
        now = 0.02 * number
        pressure = np.zeros(len(surface.positions))
        if 0.2 < now < 0.2 + length:
            for k in range(count):
                at = start[k] + drift[k] * np.sin(2 * np.pi * rates[k] * now + phases[k])
                apart = ((surface.positions - at) ** 2).sum(axis=1)
                swell = 0.6 + 0.4 * np.sin(2 * np.pi * rates[k] * now)
                ends = min(1.0, (now - 0.2) / 0.15, (0.2 + length - now) / 0.15)
                pressure += top[k] * swell * ends * np.exp(-apart / (2 * width[k] ** 2))
        raw = dict(rest)
        sensor = patch.sensor
        counts = np.sign(sensor.pascal_per_count) * sensor.counts(pressure)
        values = rest[patch.name].copy()
        values[normal_channels(patch, surface)] += counts
        raw[patch.name] = rest[patch.name] + np.rint((values - rest[patch.name]) * gains[patch.name])
        joints = JointReading(now, number, read_only(home), read_only(np.zeros(len(home))))
        frames = tuple(SkinFrame(key, now, number, read_only(value)) for key, value in raw.items())
        perception = perceiver.step(Reading(joints, frames), now)
        begun = time.thread_time()
        _, memory = listener.step(memory, perception, body)
        slowest = max(slowest, time.thread_time() - begun)
        words += [(now, one) for one in memory.new]
        if len(perception.contacts):
            felt, last = True, now
    if not felt:
        return None
    return _outcome(name, "other", words, last, float("nan"), slowest, False, f"sleeve on {patch.name}")


# ---------------------------------------------------------------------- what they share

_TOOK = [0.0]


def _listen(
    name: str, world: World, random: np.random.Generator, faults: bool, listener: TouchWords, end: float,
    drive: Callable[[float], None] | None = None,
) -> Iterator[Seen]:  # fmt: skip
    body = tci.GenericBody(world.robot)
    perceiver, memory = Perceiver(body), listener.init(body)
    gains = _gains(name, random, faults)
    rest = {one.name: float(one.sensor.rest) for one in world.robot.skin}
    _TOOK[0] = 0.0
    period = 1.0 / max(one.rate for one in world.robot.skin)
    while world.time < end:
        if drive is not None:
            drive(world.time)
        world.advance(world.time + period)
        frames = tuple(
            SkinFrame(
                one.patch, one.stamp, one.sequence,
                read_only(rest[one.patch] + np.rint((one.values - rest[one.patch]) * gains[one.patch])),
            )
            for one in world.frames()
        )  # fmt: skip
        perception = perceiver.step(Reading(world.joints(), frames), world.time)
        begun = time.thread_time()
        _, memory = listener.step(memory, perception, body)
        took = time.thread_time() - begun
        _TOOK[0] = max(_TOOK[0], took)
        yield world.time, perception, memory.new


def _gains(name: str, random: np.random.Generator, faults: bool) -> dict[str, Array]:
    """With faults, gains of the channels spread by 20 % (standard deviation), and 5 % of them are dead."""
    return {
        one.name: np.exp(random.normal(0.0, 0.2, one.channels)) * (random.random(one.channels) >= 0.05)
        if faults and not one.sensor.switch else np.ones(one.channels)
        for one in tci.load_robot(name).skin
    }  # fmt: skip


def _patches(name: str, grips: bool) -> list[str]:
    robot = tci.load_robot(name)
    found = [one for one in robot.skin if one.channels > 12 and not one.sensor.switch]
    limbs = [one for one in found if one.segment in ("upper_arm", "forearm", "thigh", "shank")]
    return [one.name for one in (limbs if grips and limbs else found)]


def _outcome(
    name: str, true: str, words: list[Told], last: float, most: float, slowest: float, bare: bool, note: str
) -> Outcome:
    told = tuple(one.word for _, one in words)
    late = words[-1][0] - last if words else float("nan")
    certainty = words[-1][1].certainty if words else float("nan")
    return Outcome(name, true, told, certainty, late, most, slowest, bare, note)


@cache
def _hand_world(name: str) -> World:
    return World(name, people=1, noise=0.3)


@cache
def _thing_world(name: str) -> World:
    return World(
        name, noise=0.3,
        obstacles=[
            Obstacle(name="table", stiffness=50e3, box=(0.1, 0.1, 0.02)),
            Obstacle(name="chest", stiffness=15e3, radius=0.12, half=0.2),
            Obstacle(name="edge", stiffness=50e3, radius=0.008, half=0.2),
        ],
    )  # fmt: skip


def macro_f1(outcomes: list[Outcome]) -> tuple[float, dict[str, float]]:
    """Mean F1 over the words and `other`, and that of each. A squeeze whose other side is bare may be told as
    press."""
    pairs = [
        (one.true, one.true if one.bare and one.true == "squeeze" and one.word == "press" else one.word)
        for one in outcomes
    ]
    scores = {}
    for word in dict.fromkeys(true for true, _ in pairs):
        right = sum(pair == (word, word) for pair in pairs)
        named = sum(told == word for _, told in pairs)
        meant = sum(true == word for true, _ in pairs)
        scores[word] = 2.0 * right / (named + meant)
    return float(np.mean(list(scores.values()))), scores
