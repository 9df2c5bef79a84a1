"""Trials of touch words: who touches which place how, with laid pressure, and what the robot feels of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.capabilities.touch_words.tracks import Track, Tracks, follow
from tci.messages import JointReading, Perception, Reading, SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.joint_map import initial_position
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface
from tci.touches.kinds import KINDS, STRENGTHS, read_kinds
from tci.touches.laid import LaidTouches
from tci.touches.person import Person
from tci.touches.planned_touch import PlannedTouch, plan
from tci.touches.touch import Touch

OTHERS = read_kinds(Path(__file__).with_name("others.csv"), {})
"""What touches a robot and means nothing, as kinds of touches."""
LIMBS = "forearm", "upper_arm", "thigh", "shank"
MOVING = "bump", "bump_flat", "scrape", "self_touch", "rest_on"
"""Of these, the ones that come of the robot's own motion."""
SPEEDS = 0.03, 2.0
"""Least and largest speed [rad/s] with which the robot runs into what it meets. Assumed."""
SOMETIMES = 0.1
"""How often the robot moves while somebody touches it, at a tenth of these speeds. Assumed: people seldom
touch what moves quickly."""
HARD = *MOVING, "lean"
"""The ones that also press with edges and bones."""
BONE_MM = 3.0
"""Radius [mm] with which the hardest pads press. Edges and things of the simulation press at points, whatever
their size."""
HARDEST = 0.8
"""Least softness of a hand and of cloth. Assumed: hands differ mostly in size, which the person has."""
ON_SKIN = 0.8, 0.01
"""Fraction of the time for which a pad is within a distance [m] of a taxel: people touch where there is
room."""
TRIES = 30
FLAT = 2.5, 10.0
"""Least and largest force [N] from which the pads of people lie flat. Assumed."""
COVERS = 1.5e-3, 4.5e-3
"""Least and largest width [m] over which the skin's cover spreads a point."""
WOBBLE = 3e-3
"""Standard deviation [m] of how the least steady hand rolls and slips. Assumed."""
GAPS, PATCHY = 0.4, 0.5
"""Largest fraction of a skin that gaps take, and how often a skin has gaps. Assumed: iCub's triangles leave
as much of its arms bare."""
WIDE = 4e-3, 12e-3
"""Least and largest radius [m] of a gap."""
NOISE = 0.5
"""Largest standard deviation [counts] of what a taxel sends: a third of a skin at rest is then a count off.
Assumed."""
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
    gaps: float = 0.0
    """Fraction of the touched skin that gaps take."""
    moves: float = 0.0
    """Speed [rad/s] with which the robot moves then."""
    softness: float = 1.0
    """From 0, where every pad presses at a point, to 1, where its radius is that of its kind."""
    flat: float = 0.0
    """Force [N] from which a pad lies flat, see `LaidTouches`."""
    cover: float = 0.0
    """Width [m] over which the skin's cover spreads a point."""
    noise: float = 0.0
    """Standard deviation [counts] of what a taxel sends."""
    seed: int = 0


def limb_patches(body: GenericBody) -> list[str]:
    return [one.name for one in body.robot.patches if one.segment in LIMBS]


def draw(
    body: GenericBody, kind: str, random: np.random.Generator, *, patches: list[str], who: str,
    strengths: tuple[str, ...] = ("normal",), faults: float = 0.0,
) -> Trial:  # fmt: skip
    """A random trial on some patches, at a place with room for it if one is found. `who` is a prefix: persons
    of another one are other persons."""
    for _ in range(TRIES):
        trial = _drawn(body, kind, random, patches, who, strengths, faults)
        if kind not in KINDS or _has_room(trial, body):
            break
    return trial


def _drawn(
    body: GenericBody, kind: str, random: np.random.Generator, patches: list[str], who: str,
    strengths: tuple[str, ...], faults: float,
) -> Trial:  # fmt: skip
    grips = (KINDS.get(kind) or OTHERS[kind]).hand == "grip"
    limbs = [name for name in patches if name in limb_patches(body)]
    patch = str(random.choice(limbs if grips and limbs else patches))
    taxel = int(random.integers(len(body.skin.surfaces[patch].positions)))
    person = Person.drawn(f"{who}{random.integers(10000)}", varies=float(random.choice([0.5, 1.0])))
    faulty = random.random() < faults
    speed = float(np.exp(random.uniform(*np.log(SPEEDS))))
    people = kind not in MOVING
    return Trial(
        kind, f"{patch} taxel {taxel}", person, str(random.choice(strengths)),
        0.2 if faulty else 0.0, 0.05 if faulty else 0.0,
        float(random.uniform(0.0, GAPS)) if random.random() < PATCHY else 0.0,
        speed if not people else speed / 10.0 if random.random() < SOMETIMES else 0.0,
        float(random.uniform(0.0 if kind in HARD else HARDEST, 1.1)),
        float(np.exp(random.uniform(*np.log(FLAT)))) if kind in KINDS else 0.0,
        float(random.uniform(*COVERS)), float(random.uniform(0.0, NOISE)), int(random.integers(2**31)),
    )  # fmt: skip


def _planned(trial: Trial, body: GenericBody) -> tuple[PlannedTouch, ...]:
    kind = {**KINDS, **OTHERS}[trial.kind]
    low, high = (BONE_MM * (radius / BONE_MM) ** trial.softness for radius in kind.radius_mm)
    kinds = {kind.name: replace(kind, radius_mm=(low, high))}
    touch = Touch(trial.kind, trial.place, BEFORE, person=trial.person.name, strength=trial.strength)
    return plan(body, touch, persons={trial.person.name: trial.person}, kinds=kinds, seed=trial.seed)


def _has_room(trial: Trial, body: GenericBody) -> bool:
    (one,) = _planned(trial, body)
    positions = body.skin.surfaces[one.patch].positions
    pressed = one.centre[:1, 0] if one.kind.hand == "grip" else one.centre[one.force > 0.0][::4]
    least, near = ON_SKIN
    apart = np.linalg.norm(pressed[:, None] - positions, axis=2).min(axis=1)
    return float((apart < near).mean()) >= least


def laid(trial: Trial, body: GenericBody) -> Iterator[Perception]:
    """What the robot perceives of a trial whose pressure is laid on the taxels."""
    random = np.random.default_rng(trial.seed)
    planned = _planned(trial, body)
    touched = LaidTouches(
        body, [_wobbling(one, random) for one in planned], flat=trial.flat, cover=trial.cover
    )
    home = np.array(initial_position(body.robot))
    turning = 2.0 * np.pi * random.uniform(0.5, 1.5)
    phase = random.uniform(-1.0, 1.0) - turning * BEFORE
    gains = {
        patch.name: np.exp(random.normal(0.0, trial.spread, patch.channels))
        * (random.random(patch.channels) >= trial.dead)
        for patch in body.robot.skin
    }
    for one in planned:
        patch, surface = body.robot.patch(one.patch), body.skin.surfaces[one.patch]
        gains[one.patch][normal_channels(patch, surface)[_bare(surface, trial.gaps, random)]] = 0.0
    rest = {patch.name: np.full(patch.channels, float(patch.sensor.rest)) for patch in body.robot.skin}
    noise = {patch.name: 0.0 if patch.sensor.switch else trial.noise for patch in body.robot.skin}
    perceiver = Perceiver(body)
    times = np.arange(0.0, touched.end + AFTER, PERIOD)
    frames = touched.frames(times)
    frames = {name: rest[name] + np.rint((raw - rest[name]) * gains[name]) for name, raw in frames.items()}
    for count, now in enumerate(times.tolist()):
        turned = turning * now + phase
        position: Array = home + trial.moves / turning * np.sin(turned)
        velocity: Array = np.full(len(home), trial.moves * np.cos(turned))
        skin = tuple(
            SkinFrame(
                name, now, count,
                read_only(
                    (frames[name][count] if name in frames else raw)
                    + np.rint(random.normal(0.0, noise[name], len(raw)))
                ),
            )
            for name, raw in rest.items()
        )  # fmt: skip
        joints = JointReading(now, count, read_only(position), read_only(velocity))
        yield perceiver.step(Reading(joints, skin), now)


def _bare(surface: Surface, share: float, random: np.random.Generator) -> NDArray[np.bool_]:
    """Which taxels (n,) are missing on a skin whose gaps take a `share` of it."""
    radius, bare = random.uniform(*WIDE), np.zeros(len(surface.areas), bool)
    while bare.mean() < share:
        middle = surface.positions[random.integers(len(bare))]
        bare |= np.linalg.norm(surface.positions - middle, axis=1) < radius
    return bare


def _wobbling(one: PlannedTouch, random: np.random.Generator) -> PlannedTouch:
    """The same touch of a hand that rolls and slips a little, as hands do."""
    count = len(one.times)
    nodes = random.normal(0.0, WOBBLE * random.random(), (count // 10 + 3, 1, 3))
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
