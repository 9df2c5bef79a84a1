"""Limits of a model that can't be meant: mended from the joint's own numbers or from the other side's, never
to a wider range, and told."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from tci.lab.authoring.find_limbs import MIRRORED, FoundLimbs, extent_of
from tci.lab.authoring.joint_facts import FASTEST, FINGER_TORQUE, SPEED, TORQUE, JointFacts, read_facts
from tci.messages.frames import Array
from tci.robot.description import Limits, Model, Robot
from tci.robot.kinematics import bare_model
from tci.robot.model_file import BOUND_INERTIA, BOUND_MASS, compiled, load_spec
from tci.robot.xml.node import listed
from tci.support.engine import mujoco

TURN = 2.0 * np.pi * (1.0 + 1e-6)
DEGREES = (2.0 * TURN, 720.0)
"""A range that ends between these angles [rad] is taken as written in degrees: no joint of a body turns
farther than twice, and a larger number is a placeholder."""
UNEVEN = float(np.deg2rad(5.0))
"""Largest difference [rad] between the ranges of a left and a right joint that is not told."""
NONE, OTHER = "the model has none or 0", "; that of the other side"

Twins = Mapping[str, tuple[str, float]]
"""By joint: its mirror image on the other side, and 1 if both turn alike for the same sign, else -1."""


def twins_of(body: FoundLimbs) -> Twins:
    """Joints whose places and axes are mirror images at the model's zero, in both directions."""
    median = sum(float(limb.centre[1]) for limb in body.arms.values()) / 2.0
    tolerance = MIRRORED * extent_of(body.joints)
    found: dict[str, tuple[str, float]] = {}
    for left in body.joints:
        if left.anchor[1] - median < tolerance:
            continue
        place = left.anchor * [1.0, -1.0, 1.0] + [0.0, 2.0 * median, 0.0]
        axis = left.axis * [-1.0, 1.0, -1.0]
        alike = [
            (one, float(np.sign(axis @ one.axis))) for one in body.joints
            if np.linalg.norm(one.anchor - place) < tolerance and abs(axis @ one.axis) > 1.0 - MIRRORED
        ]  # fmt: skip
        if len(alike) == 1:
            (right, sign) = alike[0]
            found |= {left.name: (right.name, sign), right.name: (left.name, sign)}
    return found


def mended(facts: Mapping[str, JointFacts], twins: Twins) -> dict[str, JointFacts]:
    """The facts with what can't be meant replaced: a range in degrees is converted, one of more than a turn
    is cut to half a turn each way, and what is still missing is taken from the joint's mirror image."""
    cut = {name: _cut(one) for name, one in facts.items()}
    made = {}
    for name, one in cut.items():
        other, sign = twins.get(name, ("", 1.0))
        made[name] = one if other not in cut else _as_other(one, cut[other], sign)
    return made


def _cut(facts: JointFacts) -> JointFacts:
    most = max(-facts.lower, facts.upper)
    if not facts.lower < facts.upper or most <= TURN:
        return facts
    if DEGREES[0] < most <= DEGREES[1]:
        lower, upper = np.deg2rad([facts.lower, facts.upper]).tolist()
    else:
        lower, upper = max(facts.lower, -np.pi), min(facts.upper, np.pi)
    return replace(facts, lower=lower, upper=upper, assumed=("lower", "upper"))


def _as_other(one: JointFacts, other: JointFacts, sign: float) -> JointFacts:
    if not one.lower < one.upper and other.lower < other.upper:
        lower, upper = sorted((sign * other.lower, sign * other.upper))
        one = replace(one, lower=lower, upper=upper, assumed=(*one.assumed, "lower", "upper"))
    if not 0.0 < one.velocity < FASTEST and 0.0 < other.velocity < FASTEST:
        slower = min(other.velocity, SPEED)  # a motor whose speed nobody tells is not trusted with more
        one = replace(one, velocity=slower, assumed=(*one.assumed, "velocity"))
    if not 0.0 < one.torque < TORQUE[1] and 0.0 < other.torque < TORQUE[1]:
        one = replace(one, torque=other.torque, assumed=(*one.assumed, "torque"))
    return one


def assumed_limits(robot: Robot) -> list[str]:
    """One line for each kind of limit that a proposal could not take from the model, with joints, figure and
    reason, and one for each pair of joints whose ranges are no mirror images."""
    if robot.model is None:
        return []
    facts, groups = _facts(robot.model), dict[str, list[str]]()
    for servo in robot.servos:
        if servo.joint in facts:
            for line in _reasons(facts[servo.joint], servo.limits):
                groups.setdefault(line, []).append(servo.name)
    lines = ["acceleration and jerk of all joints: no model has them; from torque and inertia"]
    for line, names in groups.items():
        which = "all joints" if len(names) == len(robot.servos) > 1 else listed(names, most=8)
        lines.append(line.format(which))
    return [*lines, *_uneven(robot)]


def _reasons(given: JointFacts, limits: Limits) -> Iterator[str]:
    if "lower" in limits.assumed and limits.lower is not None and limits.upper is not None:
        low, high = np.rad2deg([limits.lower, limits.upper])
        had = f"the model's {given.lower:.4g} to {given.upper:.4g} rad"
        most = max(-given.lower, given.upper)
        if not given.lower < given.upper:
            why = "the model has no range"
        elif DEGREES[0] < most <= DEGREES[1]:
            why = f"{had} are more than two turns, so they are read as degrees"
        else:
            why = f"{had} are more than a turn"
        yield f"range {low:.4g} to {high:.4g} degrees of {{}}: {why}"
    if "velocity" in limits.assumed and limits.velocity is not None:
        if given.velocity >= FASTEST:
            why = f"the model's {given.velocity:.4g} rad/s are a placeholder"
        elif given.velocity > 0.0:
            why = f"at the model's {np.rad2deg(given.velocity):.4g} its damping takes the torque"
        else:
            why = NONE
        usual = (
            np.isclose(limits.velocity, SPEED, rtol=1e-3) or given.damping or 0.0 < given.velocity < FASTEST
        )
        yield f"speed {np.rad2deg(limits.velocity):.4g} degrees/s of {{}}: {why}{'' if usual else OTHER}"
    if "torque" in limits.assumed and limits.torque is not None:
        why = f"the model's {given.torque:.4g} N m are a placeholder" if given.torque else NONE
        usual = limits.torque in (TORQUE[0], FINGER_TORQUE[0])
        yield f"torque {limits.torque:.4g} N m of {{}}: {why}{'' if usual else OTHER}"


def _uneven(robot: Robot) -> Iterator[str]:
    """Ranges of left and right generic joints that differ. Of retargeted ones equal and opposite ranges count
    as even."""
    named = {part.name: part for part in robot.parts}
    for left in robot.parts:
        right = named.get(left.name.replace("left", "right", 1))
        if right is None or right is left:
            continue
        for one, other in zip(left.servos, right.servos, strict=False):
            if one.servo is None or other.servo is None or one.name != other.name:
                continue
            ranges = [_range(robot.servos[servo].limits) for servo in (one.servo, other.servo)]
            turned = -ranges[1][::-1]
            if min(np.abs(ranges[0] - way).max() for way in (ranges[1], turned)) > UNEVEN:
                words = [f"{low:.4g} to {high:.4g}" for low, high in np.rad2deg(ranges)]
                names = [robot.servos[servo].name for servo in (one.servo, other.servo)]
                yield (
                    f"ranges of {names[0]} and {names[1]}, {words[0]} and {words[1]} degrees, are no mirror "
                    "images; compare them with the robot"
                )


def _range(limits: Limits) -> Array:
    return np.array([limits.lower or 0.0, limits.upper or 0.0])


def _facts(model: Model) -> dict[str, JointFacts]:
    """The model's own figures, read without its meshes."""
    if model.format == "urdf":
        return read_facts(model, bare_model(model))
    spec = load_spec(model)
    drives = [one for one in spec.actuators if one.trntype != mujoco.mjtTrn.mjTRN_JOINT]
    ties = [one for one in spec.equalities if one.type != mujoco.mjtEq.mjEQ_JOINT]
    for element in [*spec.sensors, *drives, *ties, *spec.tendons, *spec.geoms, *spec.meshes]:
        spec.delete(element)
    spec.compiler.boundmass, spec.compiler.boundinertia = BOUND_MASS, BOUND_INERTIA
    return read_facts(model, compiled(spec, model))
