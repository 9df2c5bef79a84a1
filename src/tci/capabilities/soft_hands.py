"""Soft hands: while somebody holds a robot by the hand, its arm is soft and follows.

It needs to know only that the hand is touched, not how hard: the switches on the hands of a NAO are enough.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.needs import Need
from tci.errors import TciError
from tci.messages import Command, GenericCommand, Mode, Perception, SwitchMode
from tci.messages.frames import Array, read_only
from tci.robot.generic_fingers import FINGERS, PALM

HANDS = ("arm", "hand", "fingers")
"""Kinds of parts with skin on hands; on an arm, the skin without a limb segment."""
OF_A_HAND = ("", PALM, *FINGERS)

FOLLOWS = float(np.deg2rad(0.5))
"""Angle [rad] by which a soft arm was led when its target goes along. A target left behind is a spring, which
takes the arm back when it is let go."""


@dataclass(frozen=True, slots=True, eq=False)
class SoftArm:
    """An arm that is soft."""

    since: float
    """Time [s] of the last touch of its hand."""
    target: Array
    """Where it was led (n,) [rad]."""
    let_go: bool = False
    """It gets stiff in this step, and is still claimed for that."""


SoftArms = Mapping[str, SoftArm]
"""Memory: the arms that are soft now, by name."""


@dataclass(frozen=True)
class SoftHands(Capability[SoftArms]):
    """While a hand is held, its arm is soft and goes where it is led; let go, it is stiff again where it is.

    A soft arm is in impedance mode. Raises TciError for a setting out of range.
    """

    needs = (Need("skin on a hand", HANDS, OF_A_HAND),)
    softness: float = 0.2
    """Stiffness of a held arm, as a fraction of full stiffness. Assumed: at half of it an arm falls while it
    is held by its fingers only, at double a child can hardly lead it."""
    threshold: float = 0.3
    """Smallest force [N] on a hand that counts as holding. A pressed switch counts as 0.9 N or more."""
    quiet: float = 0.5
    """Time [s] without touch after which the arm is stiff again: a hand that leads slips in less."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.softness <= 1.0:
            raise TciError(f"soft hands: softness {self.softness}; valid: 0 to 1")
        for name in ("threshold", "quiet"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"soft hands: {name} {getattr(self, name)}; valid: above 0, finite")

    def init(self, body: GenericBody) -> SoftArms:
        return {}

    def step(
        self, memory: SoftArms, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], SoftArms]:
        now, after, orders = perception.stamp, dict[str, SoftArm](), list[Command]()
        touched = {
            _arm_of(contact.part, contact.segment, body)
            for contact in perception.contacts
            if contact.force >= self.threshold
        }
        for arm in body.parts("arm"):
            before, here = memory.get(arm), perception.posture[arm]
            before = None if before is not None and before.let_go else before
            if arm in touched and np.any(body.has_joint(arm)):
                after[arm] = SoftArm(now, here if before is None else before.target)
            elif before is not None and now - before.since < self.quiet:
                after[arm] = before
            if before is None and arm in after:
                orders += [SwitchMode(arm, Mode.IMPEDANCE), _stiffness(arm, here.size, self.softness)]
            elif before is not None and arm not in after:
                after[arm] = replace(before, let_go=True)
                orders += [SwitchMode(arm, Mode.POSITION), _stiffness(arm, here.size, 1.0)]
            elif arm in after and np.abs(here - after[arm].target).max() > FOLLOWS:
                after[arm] = replace(after[arm], target=here)
                orders.append(GenericCommand(arm, Mode.IMPEDANCE, here))
        return tuple(orders), after

    def claims(self, memory: SoftArms) -> frozenset[str]:
        """The arms that are soft."""
        return frozenset(memory)


def _stiffness(arm: str, joints: int, share: float) -> GenericCommand:
    return GenericCommand(arm, Mode.STIFFNESS, read_only(np.full(joints, share)))


def _arm_of(part: str, segment: str, body: GenericBody) -> str:
    """The arm of a touched hand; empty if it is no hand, or nobody's."""
    touched = body.robot.part(part)
    if touched.kind not in HANDS or segment not in OF_A_HAND:
        return ""
    return next((arm for arm in body.parts("arm") if body.robot.part(arm).side == touched.side), "")
