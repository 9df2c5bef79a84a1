"""Where the links are that carry skin, in one array."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from tci.frames import Array
from tci.interface.kernels.links import link_poses
from tci.model.description import Robot
from tci.model.kinematics import Kinematics
from tci.model.steps import steps_to


class LinkPoses(Mapping[str, Array]):
    """`T_TL` (4, 4) of each link by name; a view of the array that is asked for."""

    __slots__ = ("all", "names")

    def __init__(self, names: tuple[str, ...], poses: Array) -> None:
        """`poses` (l, 4, 4) of these links; they become read-only."""
        poses.setflags(write=False)
        self.names = names
        self.all = poses
        """`T_TL` (l, 4, 4) of all links."""

    def __getitem__(self, link: str) -> Array:
        if link not in self.names:
            raise KeyError(link)
        pose: Array = self.all[self.names.index(link)]
        return pose

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


class SkinLinks:
    """The forward kinematics of some links. It works in its own memory: one per thread."""

    def __init__(self, robot: Robot, kinematics: Kinematics, links: Iterable[str]) -> None:
        """Raises UnknownNameError for a link that the model lacks."""
        self.names = tuple(links)
        way = steps_to(robot, kinematics, self.names)
        self._way = way.steps, way.sums, way.ends, way.torso, np.zeros((len(way.steps), 3, 4))

    def poses(self, position: Array) -> LinkPoses:
        """At angles `position` (n_servos,) [rad]."""
        poses = np.empty((len(self.names), 4, 4))
        link_poses(np.ascontiguousarray(position, np.float64), *self._way, poses)
        return LinkPoses(self.names, poses)
