"""Where robots are poked in trials: anywhere on their arms."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np

from tci.body.places import Place
from tci.body.touchable import middle_of
from tci.errors import TciError
from tci.lab.experiments.same_stimulus import initial_joints
from tci.messages import JointReading
from tci.robot.description import Robot
from tci.simulation.world import World
from tci.skin.skin import Skin

SIDES = ("left", "right")
PER_ARM = 5
"""Number of places that are poked on each arm."""
LEAVES = 0.1
"""Depth of a poke of an upper arm that it can leave, as a fraction of the distance from the shoulder: two
fifths of the sine of the reflex's 15 degrees, since motions are slowed and not quite straight."""
LEAST = 2e-3
"""Least depth [m] of a poke: 1.6 N."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialPlace:
    """Where `trials_of` pokes."""

    part: str
    """Generic part that feels the poke."""
    name: str
    """Patch and taxel, as `World.finger.poke` takes them; the patch alone for its middle."""
    place: Place
    deepest: float
    """How deep [m] a finger goes that this part can leave: near the shoulder the arm moves little."""


def trial_places(
    world: World, sides: Sequence[str] = SIDES, *, count: int = PER_ARM, seed: int = 0
) -> Iterator[TrialPlace]:
    """Yields `count` random taxels on each arm with skin, the left one first, or on a robot without any the
    middle of each patch. Leaves out places without room for the finger, such as between arm and trunk."""
    robot, skin, joints = world.robot, Skin(world.robot), initial_joints(world.robot)
    arms = sleeves(robot)
    for part in [part for part in arms if robot.part(part).side in sides]:
        chance = np.random.default_rng([seed, *part.encode()])
        taxels = [(one, k) for one in arms[part] for k in range(len(skin.surfaces[one].positions))]
        drawn = (_taxel(skin, joints, *taxels[k]) for k in chance.permutation(len(taxels)).tolist())
        yield from islice(filter(partial(_has_room, world), drawn), count)
    if not arms:
        middles = (TrialPlace(one.part, one.name, middle_of(skin, one.name), np.inf) for one in robot.patches)
        yield from filter(partial(_has_room, world), middles)


def trial_count(robot: Robot) -> int:
    """How many places `trial_places` yields, or fewer where the finger lacks room."""
    return PER_ARM * len(sleeves(robot)) or len(robot.patches)


def sleeves(robot: Robot) -> dict[str, list[str]]:
    """The patches on the limb segments of each arm, the left arm first; arms without any are left out."""
    arms = sorted((part for part in robot.parts if part.kind == "arm"), key=lambda part: part.side != "left")
    found = {arm.name: [one for one in robot.patches if one.part == arm.name] for arm in arms}
    limbs = {arm: [one.name for one in own if robot.limb_segment(one)] for arm, own in found.items()}
    return {arm: own for arm, own in limbs.items() if own}


def _taxel(skin: Skin, joints: JointReading, patch: str, taxel: int) -> TrialPlace:
    surface, one = skin.surfaces[patch], skin.robot.patch(patch)
    place, deepest = Place(patch, surface.positions[taxel], surface.normals[taxel]), np.inf
    if one.segment == "upper_arm":
        length = skin.robot.part(one.part).segment(one.segment).length
        deepest = max(LEAVES * length * float(skin.limb(patch, joints)[0][taxel]), LEAST)
    return TrialPlace(one.part, f"{patch} {taxel}", place, deepest)


def _has_room(world: World, one: TrialPlace) -> bool:
    world.reset()
    try:
        world.finger.poke(one.place.patch, one.place.p_L, one.place.n_L, speed=1.0, depth=0.0)
    except TciError:
        return False
    world.finger.retire()
    return True
