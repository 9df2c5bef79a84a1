"""What an environment asks for, as functions: touches, reward, goal, and a hand-written answer."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.body.generic_body import GenericBody
from tci.body.places import Place
from tci.body.touchable import Touchable, touchable
from tci.capabilities.capability import Capability
from tci.capabilities.fields import default_fields
from tci.capabilities.policy.observations import OBSERVATIONS, Observation, View, no_goal
from tci.capabilities.policy.spec import PolicySpec
from tci.errors import TciError, UnknownNameError
from tci.messages import LimbPlace
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.generic_arm import SEGMENTS
from tci.simulation.hand_path import APPROACH
from tci.simulation.obstacle import Obstacle
from tci.simulation.poke_first import poke_first
from tci.simulation.world import World
from tci.touches.person import Person
from tci.touches.touch import Touch, parse_touch


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One episode, for the functions that arrange it."""

    world: World
    body: GenericBody
    part: str
    chance: np.random.Generator
    """All that is drawn for this episode comes from here, so equal seeds give equal episodes."""
    goal: Array = field(default_factory=no_goal)
    """What is asked for (g,)."""

    @property
    def robot(self) -> Robot:
        return self.world.robot


@dataclass(frozen=True, slots=True)
class Poke:
    """The finger pokes the part near the centre of a random receptive field of the withdrawal reflex; where
    the part has none, at a random taxel."""

    speed: tuple[float, float] = (0.1, 0.4)
    """Range of the speed [m/s] of the finger's base."""
    depth: tuple[float, float] = (0.006, 0.014)
    """Range of its depth [m]: 800 N/m times this is the force on a part that stays, light to painful."""

    def __call__(self, scene: Scene) -> None:
        skin, chance, joints = scene.body.skin, scene.chance, scene.world.joints()
        fields, places = default_fields(), list[Touchable]()
        felt = touchable(skin, joints, [one.place for one in fields], parts=(scene.part,))
        sites = [fields[one.site] for one in felt if one.site is not None]
        if sites:
            site = sites[int(chance.integers(len(sites)))]
            u = float(np.clip(site.u + chance.normal(0.0, 0.05), 0.1, 0.9))
            near = LimbPlace(site.segment, u, site.theta + chance.normal(0.0, 0.3))
            # without skin or room for the finger there, the centre of the field is poked instead
            places += touchable(skin, joints, [near, site.place], parts=(scene.part,))
        else:
            own = [patch.name for patch in scene.robot.patches if patch.part == scene.part]
            patch = own[int(chance.integers(len(own)))]
            surface = skin.surfaces[patch]
            taxel = int(chance.integers(len(surface.positions)))
            place = Place(patch, surface.positions[taxel], surface.normals[taxel])
            places += [Touchable(scene.part, place), *touchable(skin, joints, parts=(scene.part,))]
        poke_first(scene.world, places, speed=chance.uniform(*self.speed), depth=chance.uniform(*self.depth))


@dataclass(frozen=True, slots=True)
class PersonTouches:
    """A person does one of these touches, drawn at random; forces, lengths and so on that they leave open
    are drawn too."""

    touches: tuple[Touch, ...]

    @staticmethod
    def of(touches: Iterable[str | Touch]) -> PersonTouches:
        """From words such as `"stroke 'left forearm' 3N"`. Raises the errors of `tci.touches.parse_touch`."""
        return PersonTouches(tuple(parse_touch(one) if isinstance(one, str) else one for one in touches))

    def __call__(self, scene: Scene) -> None:
        one = self.touches[int(scene.chance.integers(len(self.touches)))]
        seed = int(scene.chance.integers(2**31))
        drawn = Person.drawn(one.person, seed=seed)
        scene.world.touch(replace(one, onset=APPROACH), persons={one.person: drawn}, seed=seed)


def nothing(scene: Scene) -> None:
    """Arranges nothing."""


@dataclass(frozen=True, kw_only=True)
class TouchTask:
    """What an environment asks for.

    `reward` is a function of what is perceived, so it also judges recordings and real robots. Change a ready
    task with `dataclasses.replace`.
    """

    reward: Callable[[View], Mapping[str, float]]
    """Terms of the reward for each second, by name. Their sum over an episode is the return."""
    baseline: Callable[[Scene], Capability[Any]]
    """A hand-written answer, to compare policies with and to learn from."""
    touch: Callable[[Scene], None] = field(default_factory=Poke)
    """Begins the touch of an episode, 10 to 40 % of `duration` after its start."""
    reset: Callable[[Scene], None] = nothing
    """Arranges the world before an episode."""
    goal: Callable[[Scene], ArrayLike] = lambda scene: ()
    """What is asked for in an episode, for the observation `goal`, in the unit of the task."""
    policy: PolicySpec = field(default_factory=PolicySpec)
    """What is seen, what actions mean, and when. `joints` and `kind` become those of the part."""
    observations: Mapping[str, Observation] = field(default_factory=dict)
    """Observations of your own, by the name that `policy` gives them."""
    success: Callable[[View], bool] = lambda view: False
    """Whether what was asked for holds, such as at the end of an episode."""
    obstacles: tuple[Obstacle, ...] = ()
    """Things in the world; `reset` places them."""
    duration: float = 1.5
    """Length [s] of an episode."""

    def complete(self, spec: PolicySpec, view: View) -> PolicySpec:
        """The spec with kind and joints of the part in `view`, and with its scales.

        Raises TciError for actions in advance, and for an unknown observation.
        """
        if spec.chunk != 1 or spec.latency:
            raise TciError(
                f"policy: chunk {spec.chunk}, latency {spec.latency} s; valid in an environment: 1 and 0, "
                "since each step has an action"
            )
        part = view.body.robot.part(view.part)
        joints = tuple(servo.name for servo in part.servos)
        if joints != spec.joints:
            scale = spec.action_scale[: len(joints)]
            scale = scale if len(scale) == len(joints) else ()
            spec = replace(spec, kind=part.kind, joints=joints, action_scale=scale, action_mean=())
        known = {**OBSERVATIONS, **self.observations}
        sizes = {name: np.size(known[name].see(view)) for name in spec.observations if name in known}
        if unknown := set(spec.observations) - set(sizes):
            raise UnknownNameError("observation", min(unknown), known)
        return spec.with_scales(sizes, self.observations)


def felt_part(robot: Robot, part: str | None = None) -> str:
    """The part that an episode touches, by default one with joints and skin, an arm in its sleeve first.

    Raises TciError for a `part` without skin, UnknownNameError for an unknown one.
    """
    worn = {patch.part for patch in robot.patches}
    if part is None:
        limbs = {patch.part for patch in robot.patches if patch.segment in SEGMENTS}
        able = [one for one in robot.parts if any(joint.servo is not None for joint in one.servos)]
        best = sorted(able, key=lambda one: (one.name not in limbs, one.kind != "arm", one.side == "right"))
        part = next((one.name for one in best if one.name in worn), "left_arm")
    name = robot.part(part).name
    if name not in worn:
        valid = ", ".join(dict.fromkeys(patch.part for patch in robot.patches))
        raise TciError(f"{robot.name} has no skin on {name}; valid: {valid or 'no part'}")
    return name
