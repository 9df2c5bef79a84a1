"""Whether a robot can be simulated and proved: the one definition that `tci new-robot`, `tci check`, `tci
check --simulate` and `tci skin check` share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tci.body.posture import to_platform
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DescriptionError, TciError
from tci.gate.safe_command import SafeCommand
from tci.lab.commissioning.both_sides import joint_pairs, pairs
from tci.lab.commissioning.weights import SPRINGS, too_heavy
from tci.lab.experiments.checker import command_violations, physics_violations
from tci.messages import GenericCommand, Mode, PlatformCommand
from tci.messages.frames import Array, angle_between, apply
from tci.reasons import Code
from tci.robot.description import GenericPart, Robot
from tci.robot.generic_arm import JOINTS, forearm_rotation, side_sign, upper_arm_rotation
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain
from tci.runtime.control import Control
from tci.simulation.world import World

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
LIMBS = ("arm", "fingers")
"""Kinds of parts of which a robot needs one for a proof."""
TARGETS, PACE = 8, 0.4
"""Number of random targets far outside the limits, and time [s] for each target. Assumed: an arm at full
speed reaches a limit within this time."""
LATELY = 25
"""Periods (50 ms in simulation) in which a motor that gave all its torque explains what the gate notices."""


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
class Verdict:
    """A robot can be simulated and proved if nothing is missing and `faults` is empty."""

    missing: str = ""
    """What the robot lacks for a proof, though it may be driven without: a model, or arms and hands."""
    faults: tuple[str, ...] = ()
    """Faults, one sentence each, with what is valid."""
    axes: tuple[Axes, ...] = ()


def judge(robot: Robot) -> Verdict:
    """Compiles the model, weighs it, simulates one period with its skin, compares the axes of its arms with
    the generic arm's, and sends arms and fingers to their limits. Takes one or two seconds.

    A step that fails is the last one, since those after it need it.
    """
    if missing := "no kinematic model" if robot.model is None else limbs_missing(robot):
        return Verdict(missing)
    try:
        heavy = [*weight_faults(robot)]
        _one_period(robot)
        axes = [compare_axes(robot, part) for part in robot.parts if part.kind == "arm"]
        # An arm that is too heavy for its motors sags, and the gate then blames something that it met.
        faults = [*heavy, *axis_faults(axes), *([] if heavy else limit_faults(robot))]
    except DescriptionError as error:
        return Verdict(faults=tuple(fault.message for fault in error.faults))
    except TciError as error:
        return Verdict(faults=(str(error),))
    return Verdict(faults=tuple(faults), axes=tuple(axes))


def limbs_missing(robot: Robot) -> str:
    """What a robot lacks that has neither an arm nor fingers, in words; empty for any other."""
    return "" if any(part.kind in LIMBS for part in robot.parts) else "no arm and no fingers"


def weight_faults(robot: Robot) -> Iterator[str]:
    """One sentence for each servo whose arm is so heavy for it that a number is wrong; `doubts` tell the
    others. Raises DescriptionError as `too_heavy`."""
    for name, torque, needed in too_heavy(robot):
        if needed > SPRINGS * torque:
            yield (
                f"{name}: torque limit of {torque:.3g} N m; the weight of the arm, stretched out, takes "
                f"{needed:.3g} N m; valid: a motor's torque in N m, and links whose masses are in kg"
            )


def _one_period(robot: Robot) -> None:
    control = Control(driver := SimulatedDriver(robot))
    for _ in control.periods(duration=driver.period):
        control.act([])


def axis_faults(axes: list[Axes]) -> Iterator[str]:
    """One sentence for each arm that can't take common postures, or whose axes are not the generic arm's."""
    for found in axes:
        if found.within_limits < LEAST_SHARE * POSTURES:
            yield (
                f"{found.part}: its limits allow {found.within_limits} of {POSTURES} common postures; valid: "
                f"at least {LEAST_SHARE:.0%}. Check the signs (gamma) and offsets (sigma) of its joints"
            )
        if not found.worst_deg <= AXIS:
            yield (
                f"{found.part}: an axis is {found.worst_deg:.1f} degrees from that of the generic arm; "
                f"valid: at most {AXIS}. Check the signs (gamma) and the order of its joints, and its mount"
            )


def compare_axes(robot: Robot, part: GenericPart) -> Axes:
    """Compares the axes of shoulder rotation, elbow and pronation with the axes of the generic arm, in random
    postures."""
    assert part.side is not None
    sign = side_sign(part.side)
    kinematics = KinematicChain(robot)
    mapped = {generic.servo for generic in part.servos if generic.servo is not None}
    hand = next(link for link in kinematics.links if mapped <= set(kinematics.chain(link)))
    worst, within = 0.0, 0
    for posture in _random_postures(robot, part):
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


def _random_postures(robot: Robot, part: GenericPart) -> Array:
    """Random generic angles (m, 5) [rad]: those that most humanoid arms can reach, and of an arm that stands
    alone those between its own limits, since there is no common way to build one."""
    generator = np.random.default_rng(2)
    if not part.stands_alone:
        low, high = RANGE.T
        return generator.uniform(low, high, size=(POSTURES, len(JOINTS)))
    joints, position = joint_map(robot, part.name), np.array(initial_position(robot))
    limits = [robot.servos[servo].limits for servo in joints.servos]
    ends = [
        (-np.pi if one.lower is None else one.lower, np.pi if one.upper is None else one.upper)
        for one in limits
    ]
    low, high = np.array(ends).T
    postures = []
    for angles in generator.uniform(low, high, size=(POSTURES, len(ends))):
        position[joints.servos] = angles
        postures.append(joints.to_generic(position))
    return np.array(postures)


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
    T_TH, jacobian = kinematics.pose_and_jacobian(position, hand)
    turns = part.R_TM.T @ jacobian[3:]
    yaw, elbow, pronation = (generic.servo for generic in part.servos[2:])
    assert elbow is not None
    bend = turns[:, elbow] * np.sign(part.servos[3].sense)
    along = part.R_TM.T @ (ends["forearm"] - ends["upper_arm"])
    if yaw is None:
        # no joint turns the upper arm: it leads from the lift's axis to the elbow's, square to them
        lift = part.servos[1].servo
        assert lift is not None
        feet = [T_TH[:3, 3] + np.cross(jacobian[3:, one], jacobian[:3, one]) for one in (lift, elbow)]
        along = part.R_TM.T @ (feet[1] - feet[0])
        upper_arm = along - bend * (bend @ along)
        upper_arm = upper_arm / np.linalg.norm(upper_arm)
    else:
        upper_arm = turns[:, yaw] * np.sign(turns[:, yaw] @ along)
    if pronation is None:
        return upper_arm, bend, None
    return upper_arm, bend, turns[:, pronation] * np.sign(part.servos[4].sense)


def limit_faults(robot: Robot) -> list[str]:
    """Commands arms, or the fingers of a robot without arms, to random targets far outside their limits.

    Returns one sentence for each violation that the module `checker` finds, and for each reason for which the
    gate refused a command or held the robot.
    """
    driver = SimulatedDriver(robot, world=World(robot, skin=False))
    generator = np.random.default_rng(4)
    sent, positions, velocities, torques = [], [], [], []
    change = -1
    arms = [part for part in robot.parts if part.kind == "arm"]
    moved = arms or [part for part in robot.parts if part.kind == "fingers"]
    control = Control(driver)
    for moment in control.periods(duration=TARGETS * PACE):
        joints = moment.reading.joints
        orders: list[PlatformCommand] = []
        if int(moment.now / PACE) > change:
            change = int(moment.now / PACE)
            for part in moved:
                target = generator.uniform(-2.0, 2.0, len(part.servos))
                if len(own := joint_map(robot, part.name).ids) == 2:  # the gate takes both for degrees
                    here = joint_map(robot, part.name).to_generic(joints.position)
                    target[own[change % 2]] = here[own[change % 2]]
                command = GenericCommand(part.name, Mode.POSITION, target)
                orders.append(to_platform(robot, command, position=joints.position))
        sent.append(control.act(orders))
        positions.append(joints.position)
        velocities.append(joints.velocity)
        torques.append(joints.torque if joints.torque is not None else np.zeros_like(joints.position))
    faults = command_violations(robot, sent, positions, driver.period)
    faults += physics_violations(robot, np.array(positions), np.array(velocities))
    weak = list(dict.fromkeys(_too_weak(robot, sent, np.abs(torques))))
    refusals = [refusal for safe in sent for refusal in safe.refusals]
    if weak:  # the gate took what such a motor left undone for somebody
        refusals = [one for one in refusals if one.code is not Code.CONTACT]
    faults += weak
    faults += dict.fromkeys(map(str, refusals))
    faults += dict.fromkeys(f"{safe.state.value}: {safe.reason}" for safe in sent if safe.reason)
    return faults


def _too_weak(robot: Robot, sent: Sequence[SafeCommand], torques: Array) -> Iterator[str]:
    """One sentence for each motor that gave all of its torque when the gate, in an empty world, took what it
    left undone for somebody, or stopped since it did not follow. `torques` (n, servos) [N m] are those
    measured before each of `sent`."""
    limits = np.array([one.limits.torque or np.inf for one in robot.servos])
    twins = {
        servo: other
        for left, right in pairs(robot)
        for one, two in joint_pairs(left, right)
        if one.servo is not None and two.servo is not None
        for servo, other in ((one.servo, two.servo), (two.servo, one.servo))
    }
    for k, safe in enumerate(sent):
        told = [*safe.clamped, *([safe.reason] if safe.reason else [])]
        if not any(one.code in (Code.CONTACT, Code.FOLLOWING_ERROR) for one in told):
            continue
        spent = torques[max(k - LATELY, 0) : k + 1].max(axis=0) >= 0.99 * limits
        for servo in map(int, np.flatnonzero(spent)):
            name, torque, twin = robot.servos[servo].name, limits[servo], twins.get(servo)
            valid = "more torque, or links whose masses and inertias are in kg and kg m2"
            if twin is not None and limits[twin] > torque:
                valid = f"{limits[twin]:.3g} N m, as {robot.servos[twin].name} has"
            yield f"{name}: its torque of {torque:.3g} N m is too little for what it moves; valid: {valid}"
