"""A part that presses somebody while its encoders or servos are not what they seem: no way back is known, so
it presses as softly as gravity permits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from tci.errors import DescriptionError, UnknownNameError
from tci.gate.contact.group import Group
from tci.gate.contact.weights import MOST, SOFT, bends
from tci.messages import Contact
from tci.messages.frames import Array
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.gravity import DOWN, Gravity
from tci.robot.joint_calibration import Tool
from tci.robot.kinematics import KinematicChain

LEAST = 0.1
"""Share of the stiffness that is left at least: dry friction holds a joint with half of it."""


class Easing:
    """Knows which share of its stiffness holds a part's weight. Without masses it keeps the whole."""

    def __init__(self, robot: Robot) -> None:
        self._torque = np.array([servo.limits.torque or np.nan for servo in robot.servos])
        self._gravity: Gravity | None = None
        self._eased = set[int]()
        try:
            self._gravity, self._chain = Gravity(robot), KinematicChain(robot)
        except (DescriptionError, UnknownNameError):
            return
        self._root = self._chain.links[0]
        self._down = self._turn(np.zeros(len(robot.servos))).T @ DOWN

    def load(self, robot: Robot, tools: Mapping[str, Tool]) -> None:
        """Notes what links carry, by the name of the link."""
        self._loaded = bends(robot, tools, most=np.inf) - bends(robot, {}, most=np.inf)

    def forget(self) -> None:
        """Angles are what they seem again."""
        self._eased.clear()

    def look(
        self,
        groups: Mapping[int, Group],
        contacts: Iterable[Contact],
        most: float,
        position: Array,
        powered: NDArray[np.bool_] | None,
        now: float,
    ) -> tuple[dict[int, float], list[Reason]]:
        """Shares (0..1) of stiffness by servo, and what to tell, of each group that still answers a contact,
        or whose skin feels more than `most` [N]; each once.

        Args:
            groups: by number.
            contacts: of all skin.
            most: see above.
            position: where the robot was last seen (n_servos,) [rad].
            powered: see `shares`.
            now: time [s].
        """
        shares, told = dict[int, float](), list[Reason]()
        for number, group in groups.items():
            felt = max((one.force for one in contacts if one.part in group.parts), default=0.0)
            answers = (group.goal is not None and group.free is None) or group.noticing.sure
            if number in self._eased or group.waist or not (answers or felt > most):
                continue  # a soft waist lets the robot fall
            self._eased.add(number)
            if found := self.shares(group, position, powered):
                shares |= found
                group.sags.told(np.array([*found]), np.array([*found.values()]), now)
                words = f"no way back is known for {group.name}, which presses somebody"
                least = f"{min(found.values()):.0%} to {max(found.values()):.0%}"
                told.append(Reason(Code.CONTACT, f"{words}: its stiffness falls to {least}"))
        return shares, told

    def shares(self, group: Group, position: Array, powered: NDArray[np.bool_] | None) -> dict[int, float]:
        """Shares (0..1) of the group's stiffness, by servo, at which gravity bends no joint by more than a
        weight may, as far as they are less than now. Servos without power keep theirs.

        Args:
            group: which presses.
            position: where the robot was last seen (n_servos,) [rad].
            powered: which servos have power (n_servos,), if that is known.
        """
        if self._gravity is None:
            return {}
        weight = self._gravity.torques(position, down=self._turn(position) @ self._down)
        bent = SOFT * np.abs(weight) / self._torque + self._loaded
        least = np.clip(bent / MOST, LEAST, 1.0)[group.servos]
        on = np.ones(len(position), bool)
        if powered is not None and powered.shape == on.shape:
            on = powered
        rows = zip(group.servos.tolist(), least.tolist(), group.sags.shares.tolist(), strict=True)
        return {servo: share for servo, share, now in rows if share < now and on[servo]}

    def _turn(self, position: Array) -> Array:
        """Rotation (3, 3) of the root in the torso frame; the root stays upright while a torso leans."""
        turn: Array = self._chain.poses(position, [self._root])[self._root][:3, :3]
        return turn
