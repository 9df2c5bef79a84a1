"""What pushes a limb: forces that its skin feels, and those that its joints bear."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tci.body import GenericBody
from tci.capabilities.gentle.load import Load
from tci.messages import Perception
from tci.messages.frames import Array, read_only

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
    bear it."""
    found = [
        Push(one.force, body.jacobian(perception, one).T @ one.n_T, one.sequence)
        for one in perception.contacts
        if one.part == part and one.patch in body.carried(part)
    ]
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
