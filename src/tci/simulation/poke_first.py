"""Pokes a robot where there is room for the finger."""

from __future__ import annotations

from collections.abc import Iterable

from tci.body.touchable import Touchable
from tci.errors import TciError
from tci.simulation.world import World


def poke_first(
    world: World, places: Iterable[Touchable], *, speed: float, depth: float, gap: float = 0.004
) -> Touchable | None:
    """Starts a poke at the first of `places` that the finger can reach; None if it reaches none.

    Args:
        world: Simulation of the robot.
        places: Places to try, the best first.
        speed: As in `Finger.poke`, like `depth` and `gap`. Where touches are felt through joints the finger
            goes twice as deep: a light touch is not felt there.
    """
    for one in places:
        through_joints = world.robot.patch(one.place.patch).through_joints
        deep = 2.0 * depth if through_joints else depth
        try:
            world.finger.poke(one.place.patch, one.place.p_L, one.place.n_L, speed=speed, depth=deep, gap=gap)
        except TciError:  # something else is in the way
            continue
        return one
    return None
