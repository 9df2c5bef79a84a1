"""What a capability needs of a robot: data, so that every tool can say it before anything moves."""

from __future__ import annotations

from dataclasses import dataclass

from tci.robot.description import GenericPart, Patch
from tci.robot.like import RobotLike, as_robot


@dataclass(frozen=True, slots=True)
class Need:
    """Something that a capability needs; one generic part that has it is enough."""

    what: str
    """What it is, for a person: `skin on an arm`."""
    parts: tuple[str, ...] = ()
    """Kinds or names of generic parts: `arm`, `left_arm`. Empty: a part of any kind."""
    segments: tuple[str, ...] = ()
    """Segments of these parts whose skin counts. Empty: any skin of the part."""
    skin: bool = True
    """False if the part alone is enough."""
    switches: bool = True
    """False if switches don't count: a field needs skin that it can lie on."""

    def skin_of(self, robot: RobotLike) -> tuple[Patch, ...]:
        """The robot's skin that counts."""
        robot = as_robot(robot)
        return tuple(
            patch
            for patch in robot.patches
            if self._is_of(robot.part(patch.part))
            and (not self.segments or patch.segment in self.segments)
            and (self.switches or not patch.sensor.switch)
        )

    def met(self, robot: RobotLike) -> bool:
        robot = as_robot(robot)
        return bool(self.skin_of(robot)) if self.skin else any(map(self._is_of, robot.parts))

    def _is_of(self, part: GenericPart) -> bool:
        return not self.parts or part.kind in self.parts or part.name in self.parts
