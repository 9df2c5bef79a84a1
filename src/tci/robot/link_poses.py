"""Where the links are that carry skin, in one array."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np

from tci.frames import Array
from tci.robot.description import Robot
from tci.robot.kernels.links import link_poses
from tci.robot.kinematics import Kinematics
from tci.robot.steps import Steps, steps_to


class LinkPoses(Mapping[str, Array]):
    """`T_TL` (4, 4) of each link by name, worked out when the first is asked for."""

    __slots__ = ("_all", "_position", "_way", "names")

    def __init__(self, names: tuple[str, ...], way: Steps, position: Array) -> None:
        """Of links at the ends of a `way`, at angles `position` (n_servos,) [rad] that nobody changes."""
        self.names = names
        self._way, self._position = way, position
        self._all: Array | None = None

    @property
    def all(self) -> Array:
        """`T_TL` (l, 4, 4) of all links."""
        if self._all is None:
            way, poses = self._way, np.empty((len(self.names), 4, 4))
            position = np.ascontiguousarray(self._position, np.float64)
            work = np.empty((len(way.steps), 3, 4))
            link_poses(position, way.steps, way.sums, way.ends, way.torso, work, poses)
            poses.setflags(write=False)
            self._all = poses
        return self._all

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
    """The forward kinematics of some links."""

    def __init__(self, robot: Robot, kinematics: Kinematics, links: Iterable[str]) -> None:
        """Raises UnknownNameError for a link that the model lacks."""
        self.names = tuple(links)
        self._way = steps_to(robot, kinematics, self.names)

    def poses(self, position: Array) -> LinkPoses:
        """At angles `position` (n_servos,) [rad] that nobody changes."""
        return LinkPoses(self.names, self._way, position)
