"""What pushes a limb: forces that its skin feels, and those that its joints bear."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tci.body import GenericBody
from tci.capabilities.gentle.load import Load
from tci.messages import Perception
from tci.messages.frames import Array, read_only

LEAST = 0.5
"""Force [N] on a hand from which on it counts: what it holds and doesn't bear presses it from all sides."""
LEVER = 0.08
"""Least lever [m] of a push: joints say little of one that is nearer to the axes."""


class Push(NamedTuple):
    """A force on an arm."""

    force: float
    """[N]"""
    into: Array
    """Speed (n,) [m/rad] into who pushes for each joint's speed."""
    frame: int
    """Number of the frame that tells it."""
    on_skin: bool = True
    """Whether skin feels it."""


def pushes_on(part: str, load: Load | None, perception: Perception, body: GenericBody) -> list[Push]:
    """What pushes a part: as its skin feels it and, where this is more or skin feels nothing, as its joints
    bear it. All that pushes the hand that an arm carries is one push: a thing that it holds presses it from
    all sides and, but for its weight, moves no arm."""
    carried = [one for one in perception.contacts if one.patch in body.carried(part)]
    found = [
        Push(one.force, body.jacobian(perception, one).T @ one.n_T, one.sequence)
        for one in carried
        if one.part == part
    ]
    if held := [one for one in carried if one.part != part]:
        force = float(np.linalg.norm(np.sum([one.force * one.n_T for one in held], axis=0)))
        if force > LEAST:
            turns = [one.force * (body.jacobian(perception, one, part).T @ one.n_T) for one in held]
            into = read_only(np.sum(turns, axis=0) / force)
            found.append(Push(force, into, max(one.sequence for one in held)))
    if load is None or not load.more.any():
        return found
    if not found:
        lever = 0.5 * sum(one.length for one in body.robot.part(part).segments) or 0.25
        force = float(np.linalg.norm(load.more)) / lever
        return [Push(force, read_only(load.more / force), round(1e6 * perception.stamp), on_skin=False)]
    strongest = max(range(len(found)), key=lambda k: found[k].force)
    into = found[strongest].into
    borne = float(load.more @ into) / max(float(into @ into), LEVER**2)
    if borne > found[strongest].force:
        found[strongest] = found[strongest]._replace(force=borne)
    return found
