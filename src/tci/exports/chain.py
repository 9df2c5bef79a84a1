"""Chains of segments in the form of OROCOS KDL. A segment is a joint and the link that the joint moves. The
frame of this link is the segment's tip.

`axis`, `origin` and `tip` of a segment are given in the frame of the previous segment's tip. A segment
corresponds to KDL's Segment(name, Joint(name, origin, axis, RotAxis), tip). For a prismatic joint, RotAxis is
replaced by TransAxis.
"""

from __future__ import annotations

import numpy as np

from tci.errors import UnknownNameError
from tci.exports.tree import Inertia, KinematicLink, Matrix, links_of, rows, vector
from tci.messages.frames import Array, invert
from tci.robot.description import Description, Robot, Vector


class ChainSegment(Description):
    """A joint and the link that the joint moves."""

    name: str
    """Name of the link."""
    servo: int | None
    """Index of the joint's servo in `Robot.servos`, or None for a fixed segment."""
    slides: bool = False
    """True for a prismatic joint, which moves the link along the axis [m], and False for a revolute joint."""
    axis: Vector
    """Unit vector of the joint's axis, in the frame of the previous segment's tip. Zero for a fixed
    segment."""
    origin: Vector
    """A point (3,) [m] on the joint's axis, in the frame of the previous segment's tip."""
    tip: Matrix
    """Pose (4, 4) of the link's frame, in the frame of the previous segment's tip, with the servo at zero."""
    inertia: Inertia | None
    """Inertia of the link, in the link's frame, or None if the model has no inertia for the link."""


def chain_to(robot: Robot, link: str) -> tuple[ChainSegment, ...]:
    """Returns the chain of segments that ends at a link. If the torso carries the link, the chain begins at
    the torso frame. Otherwise, the chain begins at the root of the model.

    The first segment is fixed. Its `tip` is the pose of the torso's link in the torso frame or, in a chain
    from the root, the identity. Raises UnknownNameError if the link does not exist, and the errors of
    `links_of`.
    """
    by_name = {found.name: found for found in links_of(robot)}
    assert robot.model is not None  # `links_of` raises an error for a robot without a model
    if link not in by_name:
        raise UnknownNameError("link of the kinematic model", link, by_name)
    torso = robot.model.torso_link
    path: list[KinematicLink] = []
    at = by_name[link]
    while at.name != torso and at.parent:
        path.insert(0, at)
        at = by_name[at.parent]
    first = invert(robot.model.T_LT) if at.name == torso else np.eye(4)
    segments = [_fixed(at, first)]
    return tuple(segments + [_segment(found) for found in path])


def ends_of(robot: Robot) -> dict[str, str]:
    """Returns for each generic part the last link that the part moves. Leaves out parts that move no link."""
    links = links_of(robot)
    ends = {}
    for part in robot.parts:
        own = {joint.servo for joint in part.servos if joint.servo is not None}
        moved = [link.name for link in links if link.servo in own]
        if moved:
            ends[part.name] = moved[-1]
    return ends


def _fixed(link: KinematicLink, pose: Array) -> ChainSegment:
    zero = (0.0, 0.0, 0.0)
    return ChainSegment(
        name=link.name, servo=None, axis=zero, origin=zero, tip=rows(pose), inertia=link.inertia
    )


def _segment(link: KinematicLink) -> ChainSegment:
    pose = np.array(link.pose)
    if link.servo is None:
        return _fixed(link, pose)
    return ChainSegment(
        name=link.name,
        servo=link.servo,
        slides=link.slides,
        axis=vector(pose[:3, :3] @ link.axis),
        origin=vector(pose[:3, :3] @ link.anchor + pose[:3, 3]),
        tip=rows(pose),
        inertia=link.inertia,
    )
