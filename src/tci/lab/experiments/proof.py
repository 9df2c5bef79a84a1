"""Tests a robot's description in simulation: the axes of the arms, the limits, and the reflexes on the
skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.touchable import without_skin
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.capability import Capability, lacks
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.gate.gate import GateState
from tci.lab.experiments.body_trials import body_trials_of
from tci.lab.experiments.checker import command_violations
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.measure import Trial
from tci.lab.experiments.patch_trials import PatchTrial, patch_trials_of
from tci.lab.experiments.poke import DEEP, Stimulus
from tci.lab.experiments.trial_places import sleeves
from tci.lab.experiments.verdict import Axes, Verdict, judge
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run
from tci.simulation.touching import people_for
from tci.simulation.world import World
from tci.touches.laid import LaidTouches
from tci.touches.planned_touch import PlannedTouch

SLOWEST = {50.0: 43.0, 100.0: 33.0}
"""Longest permitted time [ms] from touch to motion, by the frame rate [Hz] of the skin. The time consists of
one frame period of the skin, and of 23 ms for gate and servo. Assumed: the robots in `tci demo` need less
time."""
FARTHER = 5.0
"""Least distance [mm] by which the skin is farther away than without the reflex: half the depth of the usual
poke. Where an arm moves little, near its shoulder, the finger goes less deep, and half of that counts."""
PROMPT = 5.0
"""Time [ms] beside one frame of the skin within which a touch counts as felt at once. Assumed: gate and
estimate need less."""
LATE = 0.2
"""Time [s] after a touch in which its last frame arrives. Assumed: several frames of any skin."""
ON_TAXELS = 0.2
"""Least fraction of a touch on taxels from which it must be felt. Assumed."""


@dataclass(frozen=True, slots=True)
class TouchTrial:
    """One touch of a person, while the reflex of the touched part runs."""

    kind: str
    place: str
    patch: str
    asked_n: float
    felt_n: float
    """Largest force [N] that was felt on the patch."""


@dataclass(frozen=True, slots=True)
class Proof:
    """Results of all tests. A description has passed the tests if `faults` is empty."""

    robot: str
    axes: tuple[Axes, ...]
    trials: tuple[Trial, ...]
    patches: tuple[PatchTrial, ...]
    """Results of one poke of every patch."""
    faults: tuple[str, ...]
    """Faults, one sentence each. Each sentence contains the valid values."""
    skin: Literal["described", "assumed", "none", "unanswered"] = "described"
    """What the touches were tested on: "assumed" if any of it is, "none" for a robot without skin,
    "unanswered" if the reflexes cover none of its skin."""
    touches: tuple[TouchTrial, ...] = ()
    """Results of the touches of people that were asked for."""
    without_skin: tuple[str, ...] = ()
    """Parts without skin, on which no touch was tried."""

    def to_json(self) -> dict[str, Any]:
        """Returns the results as JSON values."""
        return asdict(self)


def prove(
    robot: Robot,
    *,
    verdict: Verdict | None = None,
    stimulus: Stimulus | None = None,
    touches: Sequence[PlannedTouch] = (),
    progress: Callable[[str], None] = lambda what: None,
) -> Proof:
    """Runs all tests of a robot in simulation.

    `verdict` is that of `judge`, if it is known already; a robot with faults there is not touched. `stimulus`
    is the poke with which the reflexes are tested, by default `Stimulus()`. People also do `touches`.
    `progress` is called with the name of each step.
    """
    if verdict is None:
        verdict = judge(robot)
    faults = [*verdict.faults]
    if verdict.missing:
        faults.append(f"{verdict.missing}; valid: a model, and an arm or fingers")
    if faults:
        return Proof(robot.name, verdict.axes, (), (), tuple(faults))
    patches: list[PatchTrial] = []
    body_reflex = BodyWithdrawal(stance="supported")
    for touch in patch_trials_of(robot, WithdrawalReflex(), body_reflex):
        patches.append(touch)
        faults += filter(None, [touch.fault])
        progress(f"skin, {touch.patch.replace('_', ' ')}")
    reflex = WithdrawalReflex()
    on_arms = not lacks(reflex, robot) and sleeves(robot)
    usual = Stimulus() if robot.skin else DEEP
    trials = []
    progress("reflexes")
    try:
        for trial in chain(
            trials_of(robot, reflex, stimulus=stimulus or usual, seed=0) if on_arms else (),
            body_trials_of(robot, body_reflex, stimulus=stimulus),
        ):
            trials.append(trial)
            faults += [f"{trial.side} {trial.site}: {fault}" for fault in trial_faults(robot, trial)]
            progress(f"reflex, {trial.side} {trial.site.replace('_', ' ')}")
    except TciError as error:  # a point without skin, or without room for the finger
        faults.append(f"poke {len(trials) + 1} failed: {error}")
    touched: list[TouchTrial] = []
    if touches:
        progress("touches")
        touched, found_faults = touch_trials(robot, touches)
        faults += found_faults
    return Proof(
        robot.name,
        verdict.axes,
        tuple(trials),
        tuple(patches),
        tuple(faults),
        _skin(robot, answered=any(one.responded for one in trials) or any(one.answered for one in patches)),
        tuple(touched),
        without_skin(robot),
    )


def touch_trials(robot: Robot, planned: Sequence[PlannedTouch]) -> tuple[list[TouchTrial], list[str]]:
    """Has people touch a robot whose reflex answers, and says what was felt and what was wrong: limits that a
    command broke, a stop, a touch without room for the hand, a touch of taxels that was not felt."""
    world = World(robot, people=people_for(planned))
    zero = world.touch_as_planned(planned)
    arms = all(robot.part(robot.patch(one.patch).part).kind == "arm" for one in planned)
    reflex: Capability[Any] = WithdrawalReflex() if arms else BodyWithdrawal(stance="supported")
    driver, felt = SimulatedDriver(robot, world=world), [0.0] * len(planned)
    sent, positions = [], []

    def see(tick: Tick) -> None:
        sent.append(tick.sent)
        positions.append(tick.reading.joints.position)
        for number, one in enumerate(planned):
            if one.onset <= tick.now - zero <= one.end + LATE:
                own = (contact.force for contact in tick.perception.contacts if contact.patch == one.patch)
                felt[number] = max(felt[number], sum(own))

    run(driver, reflex, duration=zero + max(one.end for one in planned) + LATE - world.time, observe=see)
    faults = command_violations(robot, sent, positions, driver.period)
    faults += dict.fromkeys(f"STOP: {safe.reason}" for safe in sent if safe.state is GateState.STOP)
    hands = [hand for person in world.people for hand in person.hands]
    faults += [f"a hand did not touch: {reason}" for hand in hands for _, reason in hand.missed]
    laid = LaidTouches(GenericBody(robot), planned)
    for number, one in enumerate(planned):
        on_taxels = not robot.patch(one.patch).through_joints and laid.share(number) >= ON_TAXELS
        if on_taxels and not felt[number]:
            faults.append(f"{one.kind.name} {one.touch.place} was not felt on {one.patch}")
    trials = [
        TouchTrial(one.kind.name, one.touch.place, one.patch, one.peak, round(force, 3))
        for one, force in zip(planned, felt, strict=True)
    ]
    return trials, faults


def _skin(robot: Robot, *, answered: bool) -> Literal["described", "assumed", "none", "unanswered"]:
    if not robot.patches:
        return "none"
    if not answered:
        return "unanswered"
    return "assumed" if any(patch.assumed for patch in robot.patches) else "described"


def _why(robot: Robot, trial: Trial, rate: float) -> str:
    """What took a late first motion its time: to feel the touch, or to start. `rate` [Hz] is the skin's."""
    felt, moved = trial.trigger_ms, trial.first_motion_ms
    if felt is None or moved is None:
        return ""
    if felt > 1e3 / rate + PROMPT:
        return (
            f". Its first command came after {felt:g} ms: the skin feels late, as taxels beside the shapes "
            "of their link or with too little pressure for a count do"
        )
    return (
        f". From the first command to the motion it took {moved - felt:g} ms: the joints start slowly, as "
        f"those with low limits of acceleration or torque do{_slowest(robot, trial.part)}"
    )


def _slowest(robot: Robot, part: str) -> str:
    """The joint of a part that accelerates least, in words; empty if no limit is known."""
    own = [robot.servos[one.servo] for one in robot.part(part).servos if one.servo is not None]
    known = [(one.limits.acceleration, one) for one in own if one.limits.acceleration is not None]
    if not known:
        return ""
    acceleration, least = min(known, key=lambda one: one[0])
    torque = "" if least.limits.torque is None else f", with {least.limits.torque:.3g} N m"
    assumed = ", assumed from torque and inertia" if "acceleration" in least.limits.assumed else ""
    return f", here {least.name} ({np.rad2deg(acceleration):.0f} degrees/s2{torque}{assumed})"


def trial_faults(robot: Robot, trial: Trial) -> list[str]:
    """One sentence for each criterion of the demo that the poke `trial` does not meet. Where touches are felt
    through joints, nobody promises that a poke is felt, how soon and where: only limits count there."""
    if any(patch.part == trial.part and patch.through_joints for patch in robot.patches):
        return [*trial.violations, *trial.halts]
    rate = min(patch.rate for patch in robot.patches)
    slowest = SLOWEST.get(rate, 23.0 + 1e3 / rate)
    never = float("inf")
    farther = min(FARTHER, 0.5 * trial.depth_mm)
    late = f"first motion after {trial.first_motion_ms} ms; valid: above 0, at most {slowest:g}"
    checks = {
        "; ".join(
            ["the reflex did not move the skin away, or moved another part too", *trial.notes]
        ): trial.responded,
        f"{late}{_why(robot, trial, rate)}": (0.0 < (trial.first_motion_ms or never) <= slowest),
        f"contact lost after {trial.contact_lost_ms} ms; valid: at most 1000": (
            (trial.contact_lost_ms or never) <= 1000.0
        ),
        "contact also lost without the reflex; valid: the finger stays on the skin": (
            trial.contact_lost_without_reflex_ms is None
        ),
        f"withdrawn by {trial.withdrawn_mm:.1f} mm, and without the reflex by "
        f"{trial.withdrawn_without_reflex_mm:.1f} mm; valid: at least {farther:.2g} mm more": (
            trial.withdrawn_mm >= trial.withdrawn_without_reflex_mm + farther
        ),
        f"error of the centre of pressure {trial.cop_error_mm} mm; valid: at most 1 mm": (
            trial.cop_error_mm is not None and trial.cop_error_mm <= 1.0
        ),
    }
    return [what for what, holds in checks.items() if not holds] + [*trial.violations, *trial.halts]
