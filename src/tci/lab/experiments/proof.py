"""Tests a robot's description in simulation: the axes of the arms, the limits, and the reflexes on the
skin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any, Literal

import numpy as np

from tci.body.generic_body import GenericBody
from tci.body.posture import to_platform
from tci.body.touchable import without_skin
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.capability import Capability, lacks
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.simulated import SimulatedDriver
from tci.errors import TciError
from tci.gate.gate import GateState
from tci.lab.experiments.body_trials import body_trials_of
from tci.lab.experiments.checker import command_violations, physics_violations
from tci.lab.experiments.experiment import SIDES, trial_places, trials_of
from tci.lab.experiments.measure import Trial
from tci.lab.experiments.patch_trials import PatchTrial, patch_trials_of
from tci.lab.experiments.poke import DEEP, Stimulus
from tci.messages import GenericCommand, Mode, PlatformCommand
from tci.messages.frames import Array, angle_between, apply
from tci.robot.description import GenericPart, Robot
from tci.robot.generic_arm import JOINTS, forearm_rotation, side_sign, upper_arm_rotation
from tci.robot.joint_map import initial_position
from tci.robot.kinematics import KinematicChain
from tci.runtime.control import Control
from tci.runtime.loop import Tick, run
from tci.simulation.touching import people_needed
from tci.simulation.world import World
from tci.touches.laid import LaidTouches
from tci.touches.planned_touch import PlannedTouch

RANGE = np.deg2rad([[-10, 95], [0, 75], [-30, 65], [15, 90], [-60, 60]])
"""Range [rad] of each generic angle in the random postures for `compare_axes`, one row for each joint from
shoulder to pronation. Assumed: most humanoid arms can reach these angles."""
POSTURES = 400
"""Number of random postures in which the axes of a robot's arm are compared with those of the generic arm.
Assumed: this number is sufficient for five joints, and the comparison takes less than one second."""
LEAST_SHARE = 0.25
"""Least fraction of the random postures that must be within the servos' limits. Assumed: with a wrong sign or
offset, a far smaller fraction is within the limits."""
AXIS = 0.5
"""Largest permitted angle [degrees] between an axis of the robot and the corresponding axis of the generic
arm. Assumed: larger than the effect of rounding in published models, smaller than the effect of a wrong
mount."""
SLOWEST = {50.0: 43.0, 100.0: 33.0}
"""Longest permitted time [ms] from touch to motion, by the frame rate [Hz] of the skin. The time consists of
one frame period of the skin, and of 23 ms for gate and servo. Assumed: the robots in `tci demo` need less
time."""
LATE = 0.2
"""Time [s] after a touch in which its last frame arrives. Assumed: several frames of any skin."""
ON_TAXELS = 0.2
"""Least fraction of a touch on taxels from which it must be felt. Assumed."""
TARGETS, PACE = 8, 0.4
"""Number of random targets far outside the limits, and time [s] for each target. Assumed: an arm at full
speed reaches a limit within this time."""


@dataclass(frozen=True, slots=True)
class Axes:
    """Comparison of one arm's axes with the axes of the generic arm, in the mount frame of the arm."""

    part: str
    within_limits: int
    """Number of the tried random postures that are within the servos' limits."""
    worst_deg: float
    """Largest angle [degrees] between an axis of the robot's arm and the corresponding axis of the generic
    arm, in all postures within the limits."""


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
    stimulus: Stimulus | None = None,
    touches: Sequence[PlannedTouch] = (),
    progress: Callable[[str], None] = lambda what: None,
) -> Proof:
    """Runs all tests of a robot in simulation.

    `stimulus` is the poke with which the reflexes are tested, by default `Stimulus()`. People also do
    `touches`. The function `progress` is called with the name of each step. Raises DescriptionError for a
    robot that can't be simulated.
    """
    faults: list[str] = []
    arms = [f"{side}_arm" for side in SIDES]
    if missing := [name for name in arms if name not in {part.name for part in robot.parts}]:
        return Proof(
            robot.name, (), (), (), (f"no part {' and '.join(missing)}; valid: a robot with two arms",)
        )
    axes = []
    for name in arms:
        progress(f"axes of {name}")
        found = compare_axes(robot, robot.part(name))
        axes.append(found)
        if found.within_limits < LEAST_SHARE * POSTURES:
            faults.append(
                f"{name}: its limits allow {found.within_limits} of {POSTURES} common postures; valid: at "
                f"least {LEAST_SHARE:.0%}. Check the signs (gamma) and offsets (sigma) of its joints"
            )
        if not found.worst_deg <= AXIS:
            faults.append(
                f"{name}: an axis is {found.worst_deg:.1f} degrees from that of the generic arm; valid: at "
                f"most {AXIS}. Check the signs (gamma) and the order of its joints, and its mount"
            )
    progress("limits")
    faults += limit_faults(robot)
    patches: list[PatchTrial] = []
    body_reflex = BodyWithdrawal(stance="supported")
    for touch in patch_trials_of(robot, WithdrawalReflex(), body_reflex):
        patches.append(touch)
        faults += filter(None, [touch.fault])
        progress(f"skin, {touch.patch.replace('_', ' ')}")
    reflex = WithdrawalReflex()
    on_arms = not lacks(reflex, robot) and any(one.site is not None for one in trial_places(robot, reflex))
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
        tuple(axes),
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
    world = World(robot, people=people_needed(planned))
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


def compare_axes(robot: Robot, part: GenericPart) -> Axes:
    """Compares the axes of shoulder rotation, elbow and pronation with the axes of the generic arm, in random
    postures."""
    assert part.side is not None
    sign = side_sign(part.side)
    kinematics = KinematicChain(robot)
    mapped = {generic.servo for generic in part.servos if generic.servo is not None}
    hand = next(link for link in kinematics.links if mapped <= set(kinematics.chain(link)))
    worst, within = 0.0, 0
    low, high = RANGE.T
    for posture in np.random.default_rng(2).uniform(low, high, size=(POSTURES, len(JOINTS))):
        command = to_platform(robot, GenericCommand(part.name, Mode.POSITION, posture))
        limits = [robot.servos[servo].limits for servo in command.servos]
        lower, upper = np.array([[limit.lower, limit.upper] for limit in limits], dtype=float).T
        if np.any(command.values < lower) or np.any(command.values > upper):
            continue
        within += 1
        position = np.array(initial_position(robot))
        position[command.servos] = command.values
        upper_arm, bend, forearm = arm_axes(robot, part, kinematics, hand, position)
        pairs = [
            (upper_arm, -upper_arm_rotation(posture, part.side, axial=False)[:, 2]),
            (bend, -upper_arm_rotation(posture, part.side, axial=True)[:, 1]),
        ]
        if forearm is not None:
            pairs.append((sign * forearm, -forearm_rotation(posture, part.side, axial=False)[:, 2]))
        worst = max(worst, *(float(np.rad2deg(angle_between(a, b))) for a, b in pairs))
    return Axes(part.name, within, worst)


def arm_axes(
    robot: Robot, part: GenericPart, kinematics: KinematicChain, hand: str, position: Array
) -> tuple[Array, Array, Array | None]:
    """Returns the unit axes (3,) of internal rotation, elbow flexion and pronation, in the mount frame. The
    axis of internal rotation points towards the elbow.

    The axis of pronation is None for an arm without pronation. `hand` is a link that all of these joints
    move.
    """
    poses = kinematics.poses(position, [segment.link for segment in part.segments])
    ends = {s.name: apply(poses[s.link], np.array(s.origin)) for s in part.segments}
    turns = part.R_TM.T @ kinematics.jacobian(position, hand)[3:]
    yaw, elbow, pronation = (generic.servo for generic in part.servos[2:])
    assert yaw is not None
    assert elbow is not None
    upper_arm = turns[:, yaw]
    upper_arm = upper_arm * np.sign(upper_arm @ (part.R_TM.T @ (ends["forearm"] - ends["upper_arm"])))
    bend = turns[:, elbow] * np.sign(part.servos[3].sense)
    if pronation is None:
        return upper_arm, bend, None
    return upper_arm, bend, turns[:, pronation] * np.sign(part.servos[4].sense)


def limit_faults(robot: Robot) -> list[str]:
    """Commands both arms to random targets far outside their limits.

    Returns one sentence for each violation that the module `checker` finds, and for each reason for which the
    gate refused a command or held the robot.
    """
    driver = SimulatedDriver(robot, world=World(robot, skin=False))
    generator = np.random.default_rng(4)
    sent, positions, velocities = [], [], []
    change = -1
    control = Control(driver)
    for moment in control.periods(duration=TARGETS * PACE):
        joints = moment.reading.joints
        orders: list[PlatformCommand] = []
        if int(moment.now / PACE) > change:
            change = int(moment.now / PACE)
            for side in SIDES:
                target = generator.uniform(-2.0, 2.0, len(JOINTS))
                command = GenericCommand(f"{side}_arm", Mode.POSITION, target)
                orders.append(to_platform(robot, command, position=joints.position))
        sent.append(control.act(orders))
        positions.append(joints.position)
        velocities.append(joints.velocity)
    faults = command_violations(robot, sent, positions, driver.period)
    faults += physics_violations(robot, np.array(positions), np.array(velocities))
    faults += dict.fromkeys(str(refusal) for safe in sent for refusal in safe.refusals)
    faults += dict.fromkeys(f"{safe.state.value}: {safe.reason}" for safe in sent if safe.reason)
    return faults


def trial_faults(robot: Robot, trial: Trial) -> list[str]:
    """One sentence for each criterion of the demo that the poke `trial` does not meet. Where touches are felt
    through joints, nobody promises that a poke is felt, how soon and where: only limits count there."""
    if any(patch.part == trial.part and patch.through_joints for patch in robot.patches):
        return [*trial.violations, *trial.halts]
    rate = min(patch.rate for patch in robot.patches)
    slowest = SLOWEST.get(rate, 23.0 + 1e3 / rate)
    never = float("inf")
    checks = {
        "the reflex did not move the skin away, or moved another part too": trial.responded,
        f"first motion after {trial.first_motion_ms} ms; valid: above 0, at most {slowest:g}": (
            0.0 < (trial.first_motion_ms or never) <= slowest
        ),
        f"contact lost after {trial.contact_lost_ms} ms; valid: at most 500": (
            (trial.contact_lost_ms or never) <= 500.0
        ),
        "contact also lost without the reflex; valid: the finger stays on the skin": (
            trial.contact_lost_without_reflex_ms is None
        ),
        f"withdrawn by {trial.withdrawn_mm:.1f} mm, and without the reflex by "
        f"{trial.withdrawn_without_reflex_mm:.1f} mm; valid: at least 5 mm more": (
            trial.withdrawn_mm >= trial.withdrawn_without_reflex_mm + 5.0
        ),
        f"error of the centre of pressure {trial.cop_error_mm} mm; valid: at most 1 mm": (
            trial.cop_error_mm is not None and trial.cop_error_mm <= 1.0
        ),
    }
    return [what for what, holds in checks.items() if not holds] + [*trial.violations, *trial.halts]
