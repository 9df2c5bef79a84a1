"""Names for the numbers that are seen of generic parts and ordered from them, the same on every robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.policy.observations import CONTACTS, OBSERVATIONS, View
from tci.errors import UnknownNameError
from tci.messages import GenericCommand, Perception
from tci.messages.frames import Array, read_only

COLUMNS = ("forearm", "u", "sin", "cos", "force", "peak", "area")
"""Names of the columns of the observation `contacts`."""
ENDINGS: Mapping[str, str] = MappingProxyType({"posture": "pos", "velocity": "vel"})
"""Ends of the names of observations that have a number for each joint. `pos` is what LeRobot's own robots
say."""
OBSERVED = ("posture", "velocity", "contacts", "taxels")


class Names:
    """Names such as `left_arm.elbow_flexion.pos`. Raises UnknownNameError for an unknown part or
    observation."""

    def __init__(self, body: GenericBody, parts: Iterable[str], observations: Iterable[str]) -> None:
        """`parts` are generic parts, all arms if none is given, or "all" of those with joints, as in sets of
        `tci log export`; `observations` are of `OBSERVED`."""
        self.body = body
        known = [part.name for part in body.robot.parts if body.has_joint(part.name).any()]
        arms = [name for name in known if body.robot.part(name).kind == "arm"]
        self.parts = tuple(parts) or tuple(arms or known)
        if self.parts == ("all",):
            self.parts = tuple(known)
        for name in self.parts:
            if name not in known:
                raise UnknownNameError("part", name, known)
        self.observations = tuple(observations)
        for name in self.observations:
            if name not in OBSERVED:
                raise UnknownNameError("observation", name, OBSERVED)
        self.joints = {
            name: [
                (n, f"{name}.{servo.name}")
                for n, (servo, there) in enumerate(
                    zip(body.robot.part(name).servos, body.has_joint(name), strict=True)
                )
                if there
            ]
            for name in self.parts
        }
        """Index and name of each joint that the robot has, by part."""
        self.actions = tuple(f"{joint}.pos" for own in self.joints.values() for _, joint in own)
        """Names of the angles of an order."""
        self.observed = tuple(name for part in self.parts for name, _, _ in self._places(part))
        """Names of the numbers that `see` gives."""

    def _places(self, part: str) -> list[tuple[str, str, int]]:
        """Name, observation, and index in it of everything that is seen of a part."""
        found = list[tuple[str, str, int]]()
        for name in self.observations:
            if name in ENDINGS:
                found += [(f"{joint}.{ENDINGS[name]}", name, n) for n, joint in self.joints[part]]
            elif name == "contacts":
                rows = [f"contact{row}.{column}" for row in range(CONTACTS) for column in COLUMNS]
                found += [(f"{part}.{row}", name, n) for n, row in enumerate(rows)]
            else:
                surfaces = self.body.skin.surfaces
                own = [patch.name for patch in self.body.robot.patches if patch.part == part]
                taxels = [f"{patch}.{n}" for patch in own for n in range(len(surfaces[patch].areas))]
                found += [(f"{taxel}.force", name, n) for n, taxel in enumerate(taxels)]
        return found

    def see(self, now: Perception, before: Perception) -> dict[str, float]:
        """What is seen now, after `before`: angles in rad, velocities in rad/s, forces in N, areas in cm2."""
        values, elapsed = dict[str, float](), now.stamp - before.stamp
        for part in self.parts:
            view = View(now, self.body, part, now.posture[part], before.posture[part], elapsed)
            seen = {name: np.ravel(OBSERVATIONS[name].see(view)) for name in self.observations}
            values |= {name: float(seen[what][n]) for name, what, n in self._places(part)}
        return values

    def order(self, values: Mapping[str, float]) -> list[GenericCommand]:
        """Orders of angles [rad], by the names of `actions`."""
        orders = list[GenericCommand]()
        for part, joints in self.joints.items():
            angles = np.array(self.body.robot.part(part).initial_posture)
            for n, name in joints:
                angles[n] = values[f"{name}.pos"]
            orders.append(GenericCommand(part, "position", read_only(angles)))
        return orders

    def angles(self, posture: Mapping[str, Array]) -> dict[str, float]:
        """Angles [rad] of a posture, by the names of `actions`."""
        return {
            f"{name}.pos": float(posture[part][n]) for part in self.parts for n, name in self.joints[part]
        }
