"""Reader of the element `generic_robot_part` (eqs 1-2 of the paper), with the segments and the mount of a
limb."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tci.messages.frames import rotation_rpy
from tci.robot import generic_fingers
from tci.robot.description import (
    USUAL_ACTUATORS,
    CartesianActuator,
    Eyes,
    GenericPart,
    GenericServo,
    Segment,
    Servo,
)
from tci.robot.description.part import MAX_MOUNT
from tci.robot.generic_arm import JOINTS, SEGMENTS
from tci.robot.xml.document import Faults
from tci.robot.xml.initial import check_initial
from tci.robot.xml.node import Node, listed
from tci.robot.xml.servos import NAMELESS, Servos, once_only
from tci.robot.xml.transforms import check_coupled, check_retarget, check_synergy, read_table, read_terms
from tci.robot.xml.values import in_unit

NAMES = {"arm": JOINTS, "fingers": generic_fingers.JOINTS}
"""Names of all generic joints of an arm and of fingers. For each such part, a file must list all these
joints. Parts of other kinds may list fewer joints."""
PIECES = {"arm": SEGMENTS, "fingers": (*generic_fingers.FINGERS, generic_fingers.PALM)}
"""Names of the segments that a part may have, by the part's kind."""
_SLACK = 1e-9
"""Tolerance [rad] for rounding errors of angles that were converted between units."""


def read_parts(root: Node, servos: Servos, faults: Faults) -> tuple[GenericPart, ...]:
    """Reads the generic parts of a file."""
    nodes = once_only(root.all("generic_robot_part"), "name", "generic_robot_part with", faults)
    alone = sum(node.get("kind") == "arm" for node in nodes) == 1
    return tuple(_part(node, servos, faults, alone=alone) for node in nodes)


def _part(node: Node, servos: Servos, faults: Faults, *, alone: bool) -> GenericPart:
    """Reads one part. `alone` is True in a file with one arm, whose mount may have any orientation."""
    name = node.get("name", "?")
    kind, side = node.get("kind", "other"), node.get("side")
    if kind in NAMES and side is None and not node.misspelt:
        faults.add(node.line, f'the {kind} {name!r} has no side; valid: side="left" or side="right"')
    nodes = _by_id(node, name, faults)
    joints = _names(node, name, kind, nodes, faults)
    positions = _initial_positions(node, nodes, faults)
    generic = [
        _generic_servo(node, joints[id], servo, servos, positions.get(id), faults)
        for id, servo in nodes.items()
    ]
    _check_targets(name, generic, nodes, servos, faults)
    check_coupled(node, generic, faults)
    check_synergy(node, generic, faults)
    check_retarget(node, kind, generic, faults)
    check_initial(generic, nodes, positions, servos, faults)
    mount = node.first("mount")
    angles = (0.0, 0.0, 0.0) if mount is None else tuple(mount.get(a, 0.0) for a in ("roll", "pitch", "yaw"))
    if mount is not None and mount.ok and not (alone and kind == "arm"):
        _check_mount(mount, angles, faults)
    segments = _segments(node, kind, faults)
    return GenericPart.model_validate(
        {
            "name": name, "kind": kind, "side": side, "servos": tuple(generic), "mount": angles,
            "segments": segments, "cartesian": _actuators(node, kind, segments, faults),
            "eyes": _eyes(node, name, kind, faults),
        }
    )  # fmt: skip


def _eyes(node: Node, name: str, kind: str, faults: Faults) -> Eyes | None:
    eyes = node.first("eyes")
    if eyes is None or not eyes.ok:
        return None
    if kind != "head":
        faults.add(eyes.line, f'{name!r} has eyes and is no head; valid: kind="head"')
    return Eyes(**eyes.fields)


def _by_id(node: Node, name: str, faults: Faults) -> dict[int, Node]:
    """Returns the elements `generic_servo` of the part named `name`, by id. Records a fault if the ids are
    not 0, 1, ... without a gap."""
    nodes = once_only(node.all("generic_servo"), "id", f"generic_servo of {name!r} with", faults)
    count = node.value("generic_servo_number")
    total = len(node.all("generic_servo"))
    if count is not None and count != total:
        line = node.all("generic_servo_number")[0].line
        faults.add(line, f"generic_servo_number is {count}, but {name!r} has {total} generic_servo elements")
    found = {child.get("id"): child for child in nodes if "id" in child.values}
    missing = [id for id in range(len(found)) if id not in found]
    if missing and len(found) == len(nodes):
        faults.add(
            node.line,
            f"ids of generic servos count up from 0: {name!r} has {listed(map(str, sorted(found)))}, "
            f"and lacks {listed(map(str, missing))}",
        )
    return dict(sorted(found.items()))


def _names(node: Node, name: str, kind: str, nodes: Mapping[int, Node], faults: Faults) -> dict[int, str]:
    """Returns the names of a part's generic joints (elements `generic_servo`) by id. The joints of arms and
    fingers have fixed names in a fixed order; another name or another number of joints is recorded as a
    fault."""
    once_only(
        [child for child in nodes.values() if "name" in child.values],
        "name",
        f"generic_servo of {name!r} with",
        faults,
    )
    names = NAMES.get(kind)
    if names is None:
        return {id: child.get("name", f"joint{id}") for id, child in nodes.items()}
    if len(node.all("generic_servo")) != len(names):
        has = "an arm has" if kind == "arm" else f"{kind} have"
        faults.add(
            node.line,
            f"{has} {len(names)} generic servos ({', '.join(names)}), {name!r} has "
            f"{len(node.all('generic_servo'))}; one that the robot lacks has the destination_servo_id none, "
            f'those in excess stay out, and what is no generic {kind} is kind="other"',
        )
        return {id: child.get("name", f"joint{id}") for id, child in nodes.items()}
    for id, child in nodes.items():
        if id < len(names) and child.get("name", names[id]) != names[id]:
            of = "an arm" if kind == "arm" else kind
            faults.add(child.line, f"generic servo {id} of {of} is {names[id]!r}, not {child.get('name')!r}")
    return {id: names[id] if id < len(names) else f"joint{id}" for id in nodes}


def _initial_positions(node: Node, nodes: Mapping[int, Node], faults: Faults) -> dict[int, Node]:
    """Returns the `servo` elements of `initial_positions`, by the id of the generic joint that they describe.
    As in the paper, `destination_servo_id` of such an element is this id."""
    group = node.first("initial_positions")
    if group is None:
        return {}
    name = node.get("name", "?")
    servos = once_only(
        group.all("servo"), "destination_servo_id", f"initial position of {name!r} with", faults
    )
    found = {
        servo.get("destination_servo_id"): servo for servo in servos if "destination_servo_id" in servo.values
    }
    valid = [id for id, child in nodes.items() if child.value("destination_servo_id") != "none"]
    for id, servo in found.items():
        if id not in nodes and any("id" not in child.values for child in node.all("generic_servo")):
            continue
        if id not in nodes:
            faults.add(
                servo.line,
                f"initial position of generic servo {id}, which {name!r} does not have; valid: "
                f"{listed(map(str, valid))} (generic ids, not the robot's)",
            )
        elif id not in valid:
            faults.add(
                servo.line,
                f"initial position of generic servo {id}, which the robot lacks: use fixed_position",
            )
    left_out = [id for id in valid if id not in found]
    if left_out and group.ok:
        faults.add(
            group.line, f"initial_positions of {name!r} leaves out generic servo {listed(map(str, left_out))}"
        )
    return found


def _generic_servo(
    part: Node, joint: str, node: Node, servos: Servos, position: Node | None, faults: Faults
) -> GenericServo:
    id = node.get("id")
    target = node.first("destination_servo_id")
    servo: Servo | None = None
    if target is not None and isinstance(target.text, int):
        robot_part = target.get("robot_part") or part.get("robot_part")
        if robot_part is not None or not (target.misspelt or part.misspelt):
            robot_part = robot_part or part.get("name", NAMELESS)
            servo = servos.find(robot_part, target.text, target.line, faults)
    lacking = target is not None and target.text == "none"
    fixed = node.first("fixed_position")
    if lacking and fixed is None:
        faults.add(node.line, f"generic servo {id} has no servo: it needs a fixed_position")
    if fixed is not None and target is not None and not lacking:
        faults.add(fixed.line, f"generic servo {id} has a servo: fixed_position is for one with none")
    kind = node.value("transform_type", "linear")
    initial = node.value("fixed_position") if lacking else position and position.get("pos")
    return GenericServo(
        **node.fields | {"name": joint}, servo=None if servo is None else servo.index,
        table=read_table(node, kind, faults), terms=read_terms(part, node, kind, servos, faults),
        initial=initial or 0.0,
    )  # fmt: skip


def _check_targets(
    name: str, generic: list[GenericServo], nodes: Mapping[int, Node], servos: Servos, faults: Faults
) -> None:
    first: dict[int, int] = {}
    for servo in generic:
        if servo.servo is None:
            continue
        if servo.servo in first and servo.transform != "synergy":
            target = servos.all[servo.servo]
            faults.add(
                nodes[servo.id].line,
                f"generic servos {first[servo.servo]} and {servo.id} of {name!r} both lead to servo "
                f"{target.id} {target.name!r}; a servo follows one of them",
            )
        first.setdefault(servo.servo, servo.id)


def _check_mount(node: Node, angles: tuple[float, ...], faults: Faults) -> None:
    turn = math.acos(min(1.0, max(-1.0, (float(np.trace(rotation_rpy(*angles))) - 1.0) / 2.0)))
    if turn > MAX_MOUNT + _SLACK:
        faults.add(
            node.line,
            f"the mount turns by {in_unit(turn, node.unit)}, valid: at most {in_unit(MAX_MOUNT, node.unit)} "
            "on a robot with two arms; another kind of shoulder needs the transform_type retarget",
        )


def _segments(node: Node, kind: str, faults: Faults) -> tuple[Segment, ...]:
    segments = []
    what = f"segment of {node.get('name', '?')!r} with"
    for child in once_only(node.all("segment"), "name", what, faults):
        valid = PIECES.get(kind)
        if valid is not None and child.get("name", valid[0]) not in valid:
            of = "an arm" if kind == "arm" else kind
            faults.add(
                child.line, f"no segment of {of} is named {child.get('name')!r}; valid: {listed(valid)}"
            )
        elif child.ok:
            segments.append(Segment(**child.fields))
    return tuple(segments)


def _actuators(
    node: Node, kind: str, segments: tuple[Segment, ...], faults: Faults
) -> tuple[CartesianActuator, ...]:
    """Returns the Cartesian actuators of a part: the actuators in the file, and for an arm with both segments
    also actuators at elbow and hand, unless the file defines these."""
    name = node.get("name", "?")
    nodes = once_only(node.all("cartesian_actuator"), "name", f"cartesian_actuator of {name!r} with", faults)
    pieces = [segment.name for segment in segments] if kind == "arm" else []
    whole = {*pieces} == {*SEGMENTS}
    found = {}
    for child in nodes:
        if not child.ok:
            continue
        actuator = CartesianActuator(**child.fields)
        found[actuator.name] = actuator
        what = f"the cartesian_actuator {actuator.name!r} of {name!r}"
        if (actuator.link is None) == (actuator.segment is None):
            faults.add(
                child.line, f"{what} is on one link, or on the axis of one segment; valid: one of both"
            )
        elif actuator.segment is not None and actuator.segment not in pieces:
            faults.add(
                child.line, f"{what}: no segment {actuator.segment!r} of an arm; valid: {listed(pieces)}"
            )
        elif actuator.frame == "shoulder" and not whole:
            valid = f'frame="torso", or an arm with {listed(SEGMENTS)}'
            faults.add(child.line, f"{what} counts from a shoulder, which {name!r} lacks; valid: {valid}")
    usual = USUAL_ACTUATORS if whole else ()
    return (*found.values(), *(actuator for actuator in usual if actuator.name not in found))
