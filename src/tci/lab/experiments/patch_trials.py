"""Trials with one poke in the middle of every patch.

The trials show if the robot's response presses the skin against the finger, which is a fault.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from tci.body.touchable import middle_of
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import TciError
from tci.lab.experiments.body_trials import deaf
from tci.lab.experiments.measure import measure
from tci.lab.experiments.poke import DEEP, Stimulus, poke_place
from tci.robot.description import Robot
from tci.simulation.world import World
from tci.skin.skin import Skin

PRESSED = 0.1
"""Force [N] by which the peak force with the reflex may exceed the peak force without the reflex. Assumed:
the difference between two simulations without a response is smaller."""


@dataclass(frozen=True, slots=True)
class PatchTrial:
    """Result of one poke of a patch."""

    patch: str
    part: str
    answered: bool
    """True if the reflex commanded this part and no other part, and the part's skin moved away from the
    finger without a fault: the gate takes back what a wrong reflex presses into somebody."""
    reason: str
    """Reason why the part did not move. The text is empty if the part moved, or if no receptive field
    contains the poked taxel."""
    peak_force_n: float
    """Largest force [N] on the finger in the trial with the reflex."""
    peak_force_without_reflex_n: float

    @property
    def fault(self) -> str:
        """Sentence that describes the fault of this trial. The text is empty if the trial has no fault."""
        if self.peak_force_n <= self.peak_force_without_reflex_n + PRESSED:
            return ""
        return (
            f"{self.patch}: {self.part} moves towards the finger and presses it with {self.peak_force_n:.1f} "
            f"N; valid: at most the {self.peak_force_without_reflex_n:.1f} N without the reflex"
        )


def patch_trials_of(
    robot: Robot, arms: WithdrawalReflex, others: BodyWithdrawal, *, seed: int = 0
) -> Iterator[PatchTrial]:
    """Pokes the taxel in the middle of every patch, with and without the reflex of the touched part.

    `arms` is the reflex of arms, and `others` the reflex of all other parts. Yields one trial per patch.
    """
    world, skin = World(robot, seed=seed), Skin(robot)
    for patch in robot.patches:
        place = middle_of(skin, patch.name)
        is_arm = robot.part(patch.part).kind == "arm"
        reflex, without = (arms, replace(arms, fields=())) if is_arm else (others, deaf(others))
        try:
            stimulus = DEEP if patch.through_joints else Stimulus()
            held = poke_place(world, place, stimulus, reflex=without, seed=seed)
            acted = poke_place(world, place, stimulus, reflex=reflex, seed=seed)
        # the finger has no room at this taxel, for example because another patch covers the taxel
        except TciError as error:
            yield PatchTrial(patch.name, patch.part, False, str(error), 0.0, 0.0)
            continue
        trial = measure(robot, patch.part, patch.name, acted, held)
        reason = "; ".join(acted.notes) or ("" if acted.contacts else "the poke was not felt")
        one = PatchTrial(patch.name, patch.part, trial.responded, reason, acted.peak_force, held.peak_force)
        yield replace(one, answered=one.answered and not one.fault)
