"""Trials of touch words: who touches which place how, with laid pressure, and what the robot feels of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.touch_words.tracks import Track, Tracks, follow
from tci.messages import JointReading, Perception, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import initial_position
from tci.touches.kinds import KINDS, STRENGTHS, read_kinds
from tci.touches.laid import LaidTouches
from tci.touches.person import Person
from tci.touches.planned_touch import PlannedTouch, plan
from tci.touches.touch import Touch

OTHERS = read_kinds(Path(__file__).with_name("others.csv"), {})
"""What touches a robot and means nothing, as kinds of touches."""
LIMBS = "forearm", "upper_arm", "thigh", "shank"
MOVING = "bump", "bump_flat", "self_touch", "rest_on"
"""Of these, the ones that come of the robot's own motion."""
GESTURES, SOMETIMES = 0.05, 0.1
"""Amplitude [rad] up to which the robot moves while somebody touches it, and how often. Assumed: people
seldom touch what moves quickly."""
BONE_MM = 3.0
"""Radius [mm] with which the hardest pads press. Simulated hands and things press at points, whatever
their size."""
WOBBLE = 1.5e-3
"""Standard deviation [m] of how a hand rolls and slips. Assumed."""
PERIOD = 0.02
"""Time [s] between frames: the slowest skin among the described robots."""
BEFORE, AFTER = 0.1, 0.6
"""Time [s] before and after a touch."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One touch of one person."""

    kind: str
    place: str
    person: Person
    strength: str = "normal"
    spread: float = 0.0
    """Standard deviation of the logarithm of the taxels' gains."""
    dead: float = 0.0
    """Fraction of taxels that feel nothing."""
    moves: float = 0.0
    """Amplitude [rad] of the robot's own motion meanwhile."""
    softness: float = 1.0
    """From 0, where every pad presses at a point, to 1, where its radius is that of its kind."""
    seed: int = 0


def limb_patches(body: GenericBody) -> list[str]:
    return [one.name for one in body.robot.patches if one.segment in LIMBS]


def draw(
    body: GenericBody, kind: str, random: np.random.Generator, *, patches: list[str], who: str,
    strengths: tuple[str, ...] = ("normal",), faults: float = 0.0,
) -> Trial:  # fmt: skip
    """A random trial on some patches. `who` is a prefix: persons of another one are other persons."""
    grips = (KINDS.get(kind) or OTHERS[kind]).hand == "grip"
    limbs = [name for name in patches if name in limb_patches(body)]
    patch = str(random.choice(limbs if grips and limbs else patches))
    taxel = int(random.integers(len(body.skin.surfaces[patch].positions)))
    person = Person.drawn(f"{who}{random.integers(10000)}", varies=float(random.choice([0.5, 1.0])))
    faulty = random.random() < faults
    if kind in MOVING:
        moves = float(np.exp(random.uniform(np.log(0.02), np.log(0.6))))
    else:
        moves = float(random.uniform(0.0, GESTURES)) if random.random() < SOMETIMES else 0.0
    return Trial(
        kind, f"{patch} taxel {taxel}", person, str(random.choice(strengths)),
        0.2 if faulty else 0.0, 0.05 if faulty else 0.0, moves,
        float(random.uniform(0.0, 1.1)), int(random.integers(2**31)),
    )  # fmt: skip


def laid(trial: Trial, body: GenericBody) -> Iterator[Perception]:
    """What the robot perceives of a trial whose pressure is laid on the taxels."""
    random = np.random.default_rng(trial.seed)
    kind = {**KINDS, **OTHERS}[trial.kind]
    low, high = (BONE_MM * (radius / BONE_MM) ** trial.softness for radius in kind.radius_mm)
    kinds = {kind.name: replace(kind, radius_mm=(low, high))}
    touch = Touch(trial.kind, trial.place, BEFORE, person=trial.person.name, strength=trial.strength)
    planned = plan(body, touch, persons={trial.person.name: trial.person}, kinds=kinds, seed=trial.seed)
    touched = LaidTouches(body, [_wobbling(one, random) for one in planned])
    home = np.array(initial_position(body.robot))
    rate, phase = random.uniform(0.3, 1.2), random.uniform(0.0, 2.0 * np.pi)
    gains = {
        patch.name: np.exp(random.normal(0.0, trial.spread, patch.channels))
        * (random.random(patch.channels) >= trial.dead)
        for patch in body.robot.skin
    }
    rest = {patch.name: np.full(patch.channels, float(patch.sensor.rest)) for patch in body.robot.skin}
    perceiver = Perceiver(body)
    times = np.arange(0.0, touched.end + AFTER, PERIOD)
    frames = touched.frames(times)
    frames = {name: rest[name] + np.rint((raw - rest[name]) * gains[name]) for name, raw in frames.items()}
    for count, now in enumerate(times.tolist()):
        turned = 2.0 * np.pi * rate * now + phase
        position: Array = home + trial.moves * np.sin(turned)
        velocity: Array = np.full(len(home), trial.moves * 2.0 * np.pi * rate * np.cos(turned))
        skin = tuple(
            SkinFrame(name, now, count, read_only(frames[name][count] if name in frames else raw))
            for name, raw in rest.items()
        )
        joints = JointReading(now, count, read_only(position), read_only(velocity))
        yield perceiver.step(Reading(joints, skin), now)


def _wobbling(one: PlannedTouch, random: np.random.Generator) -> PlannedTouch:
    """The same touch of a hand that rolls and slips a little, as hands do."""
    count = len(one.times)
    nodes = random.normal(0.0, WOBBLE, (count // 10 + 3, 1, 3))
    at = np.arange(count) / 10.0
    low = at.astype(int)
    way = nodes[low] + (at - low)[:, None, None] * (nodes[low + 1] - nodes[low])
    return replace(one, centre=read_only(one.centre + way))


def felt(trial: Trial, body: GenericBody) -> tuple[Track, ...]:
    """The touches that are felt in a trial; several if the person paused."""
    tracks, found = Tracks(), list[Track]()
    for perception in laid(trial, body):
        tracks, over = follow(tracks, perception, body)
        found += over
    return tuple(found)


__all__ = ["OTHERS", "STRENGTHS", "Trial", "draw", "felt", "laid", "limb_patches"]
