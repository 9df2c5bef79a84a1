"""Sleeves that are pushed along their limb: those of both sides alike lie as well on the model's shapes as
before, so only the ends of the segment tell."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from tci.messages import JointReading
from tci.messages.frames import read_only
from tci.robot.description import Robot, TruncatedCone
from tci.robot.joint_map import initial_position
from tci.skin.skin import Skin

PAST, PAST_ELBOW = 0.010, 0.030
"""How far [m] a sleeve may go beyond the ends of its segment, and that of an upper arm beyond the elbow:
iCub's cover does by 26 mm. A rigid sleeve bends over no joint; other robots' end 4 to 70 mm before."""


def sleeve_ends(robot: Robot, *, without: Collection[str]) -> Iterator[str]:
    """Yields a sentence for each sleeve of an arm that goes farther beyond an end of its segment. Leaves out
    the parts and patches that the sentences `without` name."""
    named = {word for sentence in without for word in sentence.split()}
    skin = Skin(robot)
    joints = JointReading(0.0, 0, initial_position(robot), read_only(np.zeros(len(robot.servos))))
    for patch in robot.skin:
        segment = robot.limb_segment(patch)
        if (
            segment is None
            or not isinstance(patch.surface, TruncatedCone)
            or {patch.name, patch.part} & named
        ):
            continue
        u = skin.limb(patch.name, joints)[0]
        ends = (
            (-float(u.min()), PAST, "before the joint that begins"),
            (float(u.max()) - 1.0, PAST_ELBOW if segment.name == "upper_arm" else PAST, "beyond the end of"),
        )
        for share, most, where in ends:
            if (past := share * segment.length) > most:
                yield (
                    f"{patch.name}: goes {1e3 * past:.0f} mm {where} its {segment.name}; valid: at most "
                    f"{1e3 * most:.0f} mm, by origin and length of its cone"
                )
