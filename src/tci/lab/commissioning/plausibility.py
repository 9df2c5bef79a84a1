"""Compares a description with its kinematic model, and the left side of the description with the right side.

The comparison finds wrong values that are valid in the file format, such as a wrong sign, limit or unit.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.spatial import KDTree

from tci.errors import TciError
from tci.lab.authoring.check_skin import AWAY, QUARTER
from tci.lab.authoring.link_points import LinkPoints
from tci.lab.authoring.proposed_parts import HAND, LEG
from tci.lab.commissioning.both_sides import UNEVEN, joint_pairs, pairs, posture_doubts
from tci.lab.commissioning.sleeve_ends import sleeve_ends
from tci.lab.commissioning.weights import weight_doubts
from tci.messages.frames import Array, apply
from tci.robot.description import GenericPart, Model, Patch, Robot, TruncatedCone
from tci.robot.generic_arm import Side, forearm_rotation
from tci.robot.joint_map import initial_position, joint_map
from tci.robot.kinematics import KinematicChain, bare_model, written
from tci.robot.mesh_files import NO_MESHES
from tci.robot.model_file import load_spec
from tci.skin.surfaces import Surface, build_surface

MIDDLE = {"pitch": (0.0, 1.0, 0.0), "roll": (1.0, 0.0, 0.0), "yaw": (0.0, 0.0, 1.0)}
"""Rotation axis of each generic joint of head and torso, in the torso frame. The rotation about this axis is
positive."""
CONTRARY = -0.5
"""If the cosine of the angle between the axis of a robot's joint and the axis of its generic joint is below
this value, the sign of the joint counts as wrong. Assumed: apart from the sign, the two axes differ by less
than 60 degrees."""
BEYOND = np.deg2rad(1.0)
"""Largest angle [rad] by which a limit in the description may exceed the limit in the model. Assumed: larger
than the error of rounding to degrees."""
APART = 0.012
"""A point on the left side counts as symmetric if it is at most this distance [m] from the mirror image of
the corresponding point on the right side. Assumed: larger than the asymmetry of real arms, and smaller than
any relevant error."""
WIDER = 1.25
"""Largest ratio between the sizes of a left patch and the corresponding right patch. Assumed: the sizes of
real patches differ by a few percent."""
PRESSURE = (3e3, 1e7)
"""Least and largest plausible pressure [Pa] at the end of a sensor's range. Assumed: a light touch is 3 kPa,
and 10 MPa destroys a skin. A count of a sensor with more than two values must be less than a light touch."""
FASTEST = 1000.0
"""Largest plausible frame rate [Hz] of a skin. Published arrays have at most 1 kHz."""
UNEQUAL = 2.0
"""Largest ratio between the torque or speed limits of a left joint and of the corresponding right one.
Assumed: both sides have motors of one kind."""
HEAVIEST = 1000.0
"""Largest plausible mass [kg] of a link. Assumed: three times that of the heaviest humanoids as a whole."""
BURIED, SLEEVED = 0.012, 0.005
"""The median taxel may lie at most BURIED [m] under the shapes of its link and of adjacent ones, that of a
sleeve around an arm at most SLEEVED. Assumed: healthy pads and soles reach 9 mm, healthy sleeves 0."""
BESIDE, THICKEST, TRIED, FEWEST = 0.008, 0.06, 120, 10
"""Shapes up to BESIDE [m] beside a taxel's normal and up to THICKEST [m] away count as above it: a limb's far
side is no cover. TRIED taxels, spread over the patch, are enough, and FEWEST are needed."""


def doubts(robot: Robot) -> list[str]:
    """Returns one sentence for each contradiction within a description, or between the description and the
    kinematic model."""
    found = [*_sensors(robot)]
    if robot.model is None:
        return found
    found += _masses(robot.model)
    found += _limits(robot)
    found += mirrored_limits(robot)
    found += posture_doubts(robot)
    chain = KinematicChain(robot)
    if torso := _torso(robot, chain):
        return [*found, torso]  # the later checks need a valid torso frame
    # The left and the right shoulder may have different solutions at generic zero. In this case the model's
    # own zero posture is still mirrored.
    postures = [_at_generic_zero(robot), np.zeros(len(robot.servos))]
    signs = [*_signs(robot, chain, postures[0])]
    found += signs
    wrong = {sentence.split()[0] for sentence in signs}  # joints with a wrong sign also have a wrong zero
    found += _segments(robot, chain, postures, without=wrong)
    found += _patches(robot, chain, postures)
    blamed = {sentence.split(":")[0] for sentence in found}
    found += _distances(robot, chain, without=blamed)
    found += sleeve_ends(robot, without=blamed)
    found += _torques(robot)
    found += _unequal_motors(robot)
    found += weight_doubts(robot)
    return found


def _masses(model: Model) -> Iterator[str]:
    spec = load_spec(model)  # its elements must not outlive it
    for body in spec.bodies:
        if body.explicitinertial and body.mass > HEAVIEST:
            yield f"link {body.name}: mass {body.mass:.3g} kg; valid: at most {HEAVIEST:g} kg, in kg"


def _sensors(robot: Robot) -> Iterator[str]:
    for patch in robot.skin:
        sensor = patch.sensor
        if patch.rate > FASTEST:
            yield f"{patch.name}: {patch.rate:g} frames/s; valid: at most {FASTEST:g}, as the fastest skins"
        if sensor.response:
            continue
        ends = [(end - sensor.rest) * sensor.pascal_per_count for end in (sensor.lowest, sensor.highest)]
        if max(ends) < -min(ends):
            yield (
                f"{patch.name}: pascal_per_count {sensor.pascal_per_count:g} makes its largest range a "
                f"suction of {-min(ends):.3g} Pa; valid: the other sign"
            )
        elif not PRESSURE[0] <= max(ends) <= PRESSURE[1]:
            yield (
                f"{patch.name}: pascal_per_count {sensor.pascal_per_count:g} makes its full range "
                f"{max(ends):.3g} Pa; valid: {PRESSURE[0]:g} to {PRESSURE[1]:g} Pa"
            )
        elif abs(sensor.pascal_per_count) > PRESSURE[0] and sensor.highest - sensor.lowest > 1.0:
            yield (
                f"{patch.name}: pascal_per_count {sensor.pascal_per_count:g} makes one count more than a "
                f"light touch; valid: at most {PRESSURE[0]:g} Pa"
            )


def _limits(robot: Robot) -> Iterator[str]:
    assert robot.model is not None
    model = bare_model(robot.model)
    ranges = {model.joint(j).name: model.jnt_range[j] for j in range(model.njnt) if model.jnt_limited[j]}
    for servo in robot.servos:
        limits = servo.limits
        if servo.joint not in ranges or limits.lower is None or limits.upper is None:
            continue
        if "lower" in limits.assumed:
            continue
        lower, upper = ranges[servo.joint]
        if upper - lower > BEYOND and np.allclose(
            np.rad2deg([limits.lower, limits.upper]), [lower, upper], atol=BEYOND
        ):
            low, high = np.rad2deg([limits.lower, limits.upper])
            yield (
                f"{servo.name}: limits of {low:.3g} to {high:.3g} degrees are the model's in radians; "
                "valid: one unit in the whole file"
            )
        if limits.lower < lower - BEYOND or limits.upper > upper + BEYOND:
            own, given = np.rad2deg([limits.lower, limits.upper]), np.rad2deg([lower, upper])
            yield (
                f"{servo.name}: limits of {own[0]:.1f} to {own[1]:.1f} degrees; the model allows "
                f"{given[0]:.1f} to {given[1]:.1f}"
            )


def mirrored_limits(robot: Robot) -> Iterator[str]:
    """Yields a sentence for each generic joint whose limits differ between the left and the right side.
    Leaves out pairs in which both joints have limits in the kinematic model.
    """
    assert robot.model is not None
    model = bare_model(robot.model)
    given = {model.joint(j).name for j in range(model.njnt) if model.jnt_limited[j]}
    for left, right in pairs(robot):
        for pair in joint_pairs(left, right):
            servos = [robot.servos[one.servo] for one in pair if one.servo is not None]
            limits = [servo.limits for servo in servos]
            if len(servos) < 2 or {servo.joint for servo in servos} <= given:
                continue
            if any(one.transform != "linear" for one in pair):
                continue
            ends = [
                sorted(
                    one.scale * limit + one.offset for limit in (own.lower, own.upper) if limit is not None
                )
                for one, own in zip(pair, limits, strict=True)
            ]
            if len(ends[0]) == len(ends[1]) == 2 and np.abs(np.subtract(ends[0], ends[1])).max() > UNEVEN:
                words = [f"{np.rad2deg(end[0]):.1f} to {np.rad2deg(end[1]):.1f}" for end in ends]
                yield (
                    f"{servos[0].name} and {servos[1].name}: generic limits of {words[0]} and of {words[1]} "
                    "degrees; valid: equal on both sides"
                )


def _unequal_motors(robot: Robot) -> Iterator[str]:
    """Yields a sentence for each generic joint whose motor on one side has a far larger limit than on the
    other."""
    for left, right in pairs(robot):
        for pair in joint_pairs(left, right):
            motors = [robot.servos[joint.servo] for joint in pair if joint.servo is not None]
            for what, unit, ends in (
                ("torque", "N m", [one.limits.torque or 0.0 for one in motors]),
                ("speed", "degrees/s", [float(np.rad2deg(one.limits.velocity or 0.0)) for one in motors]),
            ):
                if len(ends) == 2 and 0.0 < UNEQUAL * min(ends) < max(ends):
                    yield (
                        f"{motors[0].name} and {motors[1].name}: {what} limits of {ends[0]:.3g} and "
                        f"{ends[1]:.3g} {unit}; valid: equal on both sides"
                    )


def _torso(robot: Robot, chain: KinematicChain) -> str | None:
    """Returns a sentence about a fault of the torso frame, or None if the torso frame has no fault. The frame
    has a fault if a joint of another part moves an arm relative to the torso, or if a shoulder joint does not
    move the arm relative to the torso. The frame also has a fault if the left shoulder is not to the left of
    the right shoulder.
    """
    assert robot.model is not None
    others = {servo.servo: part.name for part in robot.parts if part.kind != "arm" for servo in part.servos}
    centres = {}
    for part in _arms(robot):
        own = [servo.servo for servo in part.servos if servo.servo is not None]
        way = chain.chain(part.segment("forearm").link)
        wrong = [robot.servos[servo].name for servo in way if servo in others]
        missing = [robot.servos[servo].name for servo in own[:3] if servo not in way]
        if wrong or missing:
            between = f"{', '.join(wrong)} between it and" if wrong else f"no {', '.join(missing)} before"
            return (
                f"torso_link {robot.model.torso_link}: {between} {part.name}; valid: the link with both arms"
            )
        shoulder = next(link for link in chain.links if own[0] in chain.chain(link))
        centres[part.side] = chain.poses(np.zeros(len(robot.servos)), [shoulder])[shoulder][:3, 3]
    if len(centres) == 2:
        across = centres["left"] - centres["right"]
        if across[1] < 0.8 * float(np.linalg.norm(across)):
            return (
                f"torso_link {robot.model.torso_link}: the left shoulder is not to the left of the right "
                "one in the torso frame; valid: x forward, y left, z up (torso_rpy)"
            )
    return None


def _signs(robot: Robot, chain: KinematicChain, position: Array) -> Iterator[str]:
    """Yields a sentence for each joint of head, torso, hands and legs that turns opposite to the direction of
    its generic joint."""
    for part in robot.parts:
        axes = {"head": MIDDLE, "torso": MIDDLE, "hand": HAND, "leg": LEG}.get(part.kind)
        if axes is None:
            continue
        mirror = np.array([-1.0, 1.0, -1.0] if part.side == "right" else [1.0, 1.0, 1.0])
        for generic in part.servos:
            if generic.servo is None or generic.transform != "linear" or generic.name not in axes:
                continue
            link = next((one for one in chain.links if generic.servo in chain.chain(one)), None)
            if link is None:
                continue
            turn = chain.jacobian(position, link)[3:, generic.servo] * np.sign(generic.scale)
            if part.kind == "hand":
                turn = _forearm(robot, part.side, position).T @ turn
            if part.kind == "torso":
                turn = -turn  # relative to the torso, the base turns in the opposite direction
            if float(turn @ (mirror * axes[generic.name])) < CONTRARY:
                servo = robot.servos[generic.servo].name
                yield (
                    f"{part.name} {generic.name}: {servo} turns it the wrong way; valid: the other "
                    "sign of gamma"
                )


def _forearm(robot: Robot, side: Side | None, position: Array) -> Array:
    """Rotation (3, 3) of the forearm of one side in the torso frame; the identity if it has no arm."""
    arm = next((part for part in robot.parts if part.kind == "arm" and part.side == side), None)
    if arm is None or side is None:
        return np.eye(3)
    posture = joint_map(robot, arm.name).to_generic(position)
    return np.array(arm.R_TM @ forearm_rotation(posture, side, axial=True))


def _segments(
    robot: Robot, chain: KinematicChain, postures: list[Array], *, without: set[str]
) -> Iterator[str]:
    for left, right in pairs(robot):
        if without & {left.name, right.name}:
            continue
        for one in left.segments:
            other = next((segment for segment in right.segments if segment.name == one.name), None)
            if other is None:
                continue
            apart = np.inf
            for position in postures:
                poses = chain.poses(position, [one.link, other.link])
                places = [apply(poses[segment.link], np.array(segment.origin)) for segment in (one, other)]
                apart = min(apart, _apart(*places))
            if apart > APART:
                yield (
                    f"{left.name} and {right.name}: the {one.name} of one begins {1e3 * apart:.0f} mm from "
                    f"the mirror image of the other's; valid: at most {1e3 * APART:.0f} mm"
                )


def _patches(robot: Robot, chain: KinematicChain, postures: list[Array]) -> Iterator[str]:
    """Yields a sentence for each patch on the left side that is not the mirror image of the corresponding
    patch on the right side in any of `postures`."""
    named = {patch.name: patch for patch in robot.patches}
    for left in robot.patches:
        right = named.get(left.name.replace("left", "right", 1))
        if right is None or right is left:
            continue
        apart = np.inf
        for position in postures:
            clouds = [_cloud(robot, patch, chain, position) for patch in (left, right)]
            apart = min(apart, _apart(clouds[0].mean(axis=0), clouds[1].mean(axis=0)))
        spreads = [float(np.linalg.norm(cloud - cloud.mean(axis=0), axis=1).mean()) for cloud in clouds]
        if apart > APART or max(spreads) > WIDER * min(spreads):
            yield (
                f"{left.name} and {right.name}: centres {1e3 * apart:.0f} mm apart when mirrored, taxels "
                f"{1e3 * spreads[0]:.0f} and {1e3 * spreads[1]:.0f} mm around them; valid: mirror images"
            )


def _distances(robot: Robot, chain: KinematicChain, *, without: set[str]) -> Iterator[str]:
    """Yields a sentence for each patch whose taxels are far from the surface of the link that carries them.
    Leaves out patches that the sentences `without` name."""
    assert robot.model is not None
    if robot.model.meshes == NO_MESHES or not robot.skin:
        return
    model = robot.model.model_copy(update={"torso_link": "", "torso_rpy": (0.0, 0.0, 0.0)})
    points = _points(model, written(model))
    for patch in robot.skin:
        surface = build_surface(robot, patch, chain)
        shapes = points.around(surface.link, neighbours=not _is_gripper(robot.part(patch.part)))
        if any(patch.name in words.split() for words in without) or not len(shapes):
            continue
        away = float(np.quantile(KDTree(shapes).query(surface.positions)[0], QUARTER))
        if away > AWAY:
            yield (
                f"{patch.name}: the nearest quarter of its taxels is up to {1e3 * away:.0f} mm from the "
                f"shapes of {surface.link}; valid: at most {1e3 * AWAY:.0f} mm"
            )
            continue
        under = _median_depth(surface, shapes)
        sleeve = isinstance(patch.surface, TruncatedCone) and robot.limb_segment(patch) is not None
        most = SLEEVED if sleeve else BURIED
        if under > most and len(surface.positions) >= FEWEST:
            yield (
                f"{patch.name}: half of its taxels are {1e3 * under:.0f} mm or more under the shapes of "
                f"{surface.link}; valid: at most {1e3 * most:.0f} mm"
            )


def _is_gripper(part: GenericPart) -> bool:
    """True for a thumb and an index finger alone: jaws, which may be closed over each other's pads, and over
    that of the palm, at the model's zero."""
    moved = {one.name.split("_")[0] for one in part.servos if one.servo is not None}
    return part.kind == "fingers" and moved <= {"thumb", "index"}


def _median_depth(surface: Surface, shapes: Array) -> float:
    """Median depth [m] of the taxels that have `shapes` (m, 3) above or below them."""
    tree, depths = KDTree(shapes), []
    every = max(1, len(surface.positions) // TRIED)
    for place, normal in zip(surface.positions[::every], surface.normals[::every], strict=True):
        around = shapes[tree.query_ball_point(place, THICKEST)] - place
        along = around @ normal
        near = along[np.linalg.norm(around - np.outer(along, normal), axis=1) < BESIDE]
        if near.size:
            depths.append(max(0.0, float(near.max())))
    return float(np.median(depths)) if depths else 0.0


@lru_cache(maxsize=4)
def _points(model: Model, _: tuple[int, ...]) -> LinkPoints:
    """The second argument has the times [ns] at which the files were last written, so that a changed file is
    read again."""
    return LinkPoints(model)


def _cloud(robot: Robot, patch: Patch, chain: KinematicChain, position: Array) -> Array:
    """Returns the taxels (n, 3) [m] of a patch in the torso frame."""
    surface = build_surface(robot, patch, chain)
    return apply(chain.poses(position, [surface.link])[surface.link], surface.positions)


def _apart(left: Array, right: Array) -> float:
    """Returns the distance [m] of the point `left` (3,) from the mirror image of the point `right` (3,)."""
    return float(np.linalg.norm(left - right * [1.0, -1.0, 1.0]))


def _torques(robot: Robot) -> Iterator[str]:
    """Yields a sentence for each servo whose torque limit is too low for its joint's friction and damping at
    its speed limit."""
    assert robot.model is not None
    model = bare_model(robot.model)
    mapped = {one.servo for part in robot.parts for one in part.servos}
    for servo in robot.servos:
        torque, speed = servo.limits.torque, servo.limits.velocity
        if torque is None or speed is None or servo.joint is None or servo.index not in mapped:
            continue
        dof = int(model.joint(servo.joint).dofadr[0])
        lost = float(model.dof_frictionloss[dof] + model.dof_damping[dof] * speed)
        if lost > torque:
            free = "; it has neither in simulation" if model.dof_frictionloss[dof] >= torque else ""
            yield (
                f"{servo.name}: torque limit of {torque:.3g} N m; the model's friction and damping take "
                f"{lost:.3g} N m at the speed limit of {np.rad2deg(speed):.4g} degrees/s{free}"
            )


def _arms(robot: Robot) -> list[GenericPart]:
    return [part for part in robot.parts if part.kind == "arm"]


def _at_generic_zero(robot: Robot) -> Array:
    """Returns servo angles (n,) [rad] at which all generic angles of arms and legs are 0, as far as these can
    reach this posture."""
    position = np.array(initial_position(robot))
    for part in robot.parts:
        if part.kind in ("arm", "leg"):
            joints = joint_map(robot, part.name)
            try:
                position[joints.servos] = joints.to_robot(np.zeros(len(part.servos)), position)
            except TciError:
                continue
    return position
