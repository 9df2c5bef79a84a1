"""Where robots are poked in trials, and what answers there: anywhere on arms, else on what there is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np

from tci.body.places import Place
from tci.body.touchable import middle_of
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import TciError
from tci.lab.experiments.answers import HOLDS, LETS_GO, Answer, answer_of, withdrawal
from tci.lab.experiments.same_stimulus import initial_joints
from tci.messages import JointReading
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot
from tci.simulation.world import World, start_angles
from tci.skin.skin import Skin

SIDES = ("left", "right")
PER_ARM = 5
"""Number of places that are poked on each arm."""
LEAVES = 0.1
"""Depth of a poke of an upper arm that it can leave, as a fraction of the distance from the shoulder: two
fifths of the sine of the reflex's 15 degrees, since motions are slowed and not quite straight."""
GIVES_WAY = 0.4
"""Depth of a poke of a finger that it can leave, as a fraction of its own way while the hand opens: as for
upper arms, since the reflex's blend takes their skin about as far."""
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
    answer: Answer


def trial_places(
    world: World,
    reflex: WithdrawalReflex,
    sides: Sequence[str] = SIDES,
    *,
    count: int = PER_ARM,
    seed: int = 0,
) -> Iterator[TrialPlace]:
    """Yields `count` random taxels on each arm with skin, the left one first, which `reflex` answers. On a
    robot without any, `count` random taxels of each hand with pads on its fingers; without these, the middle
    of each patch. Leaves out places without room for the finger, such as between arm
    and trunk."""
    robot, skin, joints = world.robot, Skin(world.robot), initial_joints(world.robot)
    withdraws = withdrawal(reflex)
    worn = sleeves(robot) or pads(robot)
    for part in [part for part in worn if robot.part(part).side in sides]:
        chance = np.random.default_rng([seed, *part.encode()])
        taxels = [(one, k) for one in worn[part] for k in range(len(skin.surfaces[one].positions))]
        drawn = (
            _taxel(skin, joints, withdraws, *taxels[k]) for k in chance.permutation(len(taxels)).tolist()
        )
        yield from islice(filter(partial(_has_room, world), drawn), count)
    if not worn:
        middles = (
            TrialPlace(
                one.part, one.name, middle_of(skin, one.name), np.inf, answer_of(one, robot) or withdraws
            )
            for one in robot.patches
        )
        yield from filter(partial(_has_room, world), middles)


def trial_count(robot: Robot) -> int:
    """How many places `trial_places` yields, or fewer where the finger lacks room."""
    return PER_ARM * len(sleeves(robot) or pads(robot)) or len(robot.patches)


def unanswered(robot: Robot) -> tuple[str, ...]:
    """Patches that nothing in TCI answers, of a robot without sleeves and pads."""
    if sleeves(robot) or pads(robot):
        return ()
    return tuple(one.name for one in robot.patches if one.sensor.switch and answer_of(one, robot) is None)


def sleeves(robot: Robot) -> dict[str, list[str]]:
    """The patches on the limb segments of each arm, the left arm first; arms without any are left out."""
    return _patches(robot, "arm", lambda one: bool(robot.limb_segment(one)))


def pads(robot: Robot) -> dict[str, list[str]]:
    """The pads of each hand on its fingers and palm, the left hand first; hands without any are left out."""
    return _patches(robot, "fingers", lambda one: answer_of(one, robot) in (LETS_GO, HOLDS))


def posture_of(robot: Robot) -> Mapping[str, Array]:
    """How a robot stands before it is poked: generic angles [rad] by part."""
    return {} if sleeves(robot) or not pads(robot) else LETS_GO.posture(robot)


def _patches(robot: Robot, kind: str, wanted: Callable[[Patch], bool]) -> dict[str, list[str]]:
    parts = sorted((part for part in robot.parts if part.kind == kind), key=lambda part: part.side != "left")
    found = {
        part.name: [one.name for one in robot.patches if one.part == part.name and wanted(one)]
        for part in parts
    }
    return {part: own for part, own in found.items() if own}


def _taxel(skin: Skin, joints: JointReading, withdraws: Answer, patch: str, taxel: int) -> TrialPlace:
    surface, one = skin.surfaces[patch], skin.robot.patch(patch)
    place, deepest = Place(patch, surface.positions[taxel], surface.normals[taxel]), np.inf
    answer = withdraws if skin.robot.limb_segment(one) else answer_of(one, skin.robot)
    assert answer is not None
    if one.segment == "upper_arm":
        length = skin.robot.part(one.part).segment(one.segment).length
        deepest = max(LEAVES * length * float(skin.limb(patch, joints)[0][taxel]), LEAST)
    if answer is LETS_GO:
        deepest = max(GIVES_WAY * _opening(skin, one, place), LEAST)
    return TrialPlace(one.part, f"{patch} {taxel}", place, deepest, answer)


def _opening(skin: Skin, patch: Patch, place: Place) -> float:
    """How far [m] a place goes inwards, along its normal, while a relaxed hand opens."""
    robot = skin.robot
    ends = [start_angles(robot, posture) for posture in (LETS_GO.posture(robot), {})]
    begun, ended = (skin.kinematics.poses(angles, [patch.link])[patch.link] for angles in ends)
    inward = -begun[:3, :3] @ place.n_L
    moved = (ended - begun) @ np.append(place.p_L, 1.0)
    return float(inward @ moved[:3])


def _has_room(world: World, one: TrialPlace) -> bool:
    world.reset()
    try:
        world.finger.poke(one.place.patch, one.place.p_L, one.place.n_L, speed=1.0, depth=0.0)
    except TciError:
        return False
    world.finger.retire()
    return True
