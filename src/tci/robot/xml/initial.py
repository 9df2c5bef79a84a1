"""Initial postures: computes servo angles with the inverse transforms, and checks that these angles are
within limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from tci.robot.description import GenericPart, GenericServo, Robot, Servo
from tci.robot.joint_map import initial_position
from tci.robot.transforms import Coupled, Linear, Synergy, Table, Transform
from tci.robot.xml.document import Faults
from tci.robot.xml.node import Node, listed
from tci.robot.xml.servos import Servos, check_initial_sum
from tci.robot.xml.transforms import separable
from tci.robot.xml.values import in_unit

_SLACK = 1e-9
"""Tolerance [rad] for rounding errors of angles that were converted between units."""
_SOLVED = 1e-6
"""Tolerance [rad] for errors of the angles of a retargeted shoulder, which are computed numerically."""


def initial_angles(parts: Sequence[GenericPart]) -> dict[int, float]:
    """Returns the initial angle [rad] of every servo that moves a generic joint, by the index of the servo.
    The angles are computed with the inverse transforms.

    The result contains no servos of retargeted shoulders, which need the kinematic model, and no servos whose
    transform is invalid in the description.
    """
    return {
        servo: angle
        for part in parts
        for transform in _transforms(part.servos)
        for servo, angle in _angles(transform, part.servos).items()
    }


def check_initial(
    generic: Sequence[GenericServo],
    nodes: Mapping[int, Node],
    positions: Mapping[int, Node],
    servos: Servos,
    faults: Faults,
) -> None:
    """Checks that the initial posture of a part is within the limits of its servos.

    `nodes` are the generic servos of the part, by id. `positions` are the elements that contain the initial
    positions of these servos.
    """
    initial = {joint.id: joint.initial for joint in generic}
    for transform in _transforms(generic):
        ids = transform.ids.tolist()
        if not all(nodes[id].ok and positions.get(id, nodes[id]).ok for id in ids):
            continue
        by_servo = {joint.servo: joint.id for joint in generic if joint.id in ids}
        for index, angle in _angles(transform, generic).items():
            id = by_servo.get(index, ids[0])
            servo, node = servos.all[index], positions.get(id, nodes[id])
            if not _outside(servo, angle, _SLACK):
                continue
            if isinstance(transform, Coupled):
                names = f"the initial positions of the coupled generic servos {listed(map(str, ids))} put"
                how, valid = "", "initial positions: those that keep it within"
            else:
                what = "initial position" if id in positions else "no initial position, and the default"
                names = f"{what} {in_unit(initial[id], node.unit)} of generic servo {id} puts"
                how = " (transform_table)" if isinstance(transform, Table) else " (eq. 1)"
                limits = servo.limits.lower, servo.limits.upper
                ends = sorted(float(transform.generic(np.array([limit]))[0]) for limit in limits)
                valid = "generic angles: " + " to ".join(in_unit(end, node.unit) for end in ends)
            where = _where(servo, angle, how, node)
            faults.add(node.line, f"{names} servo {servo.id} {servo.name!r} at {where}; valid {valid}")


def check_retargeted(root: Node, robot: Robot, faults: Faults) -> None:
    """Checks the initial posture of retargeted shoulders, after the model has been read. Raises the errors
    that the transforms of the shoulders raise."""
    retargeted = {
        joint.servo: part.name
        for part in robot.parts
        for joint in part.servos
        if joint.transform == "retarget"
    }
    if not retargeted:
        return
    nodes = {node.get("name"): node for node in root.all("generic_robot_part")}
    initial = dict(enumerate(initial_position(robot).tolist()))
    for servo in robot.servos:
        if servo.index in retargeted and _outside(servo, initial[servo.index], _SOLVED):
            node = nodes[retargeted[servo.index]]
            node = node.first("initial_positions") or node
            faults.add(
                node.line,
                f"the initial positions of the retargeted shoulder of {retargeted[servo.index]!r} put servo "
                f"{servo.id} {servo.name!r} at {_where(servo, initial[servo.index], '', node)}; "
                "valid initial positions: those that keep it within",
            )
    for node, coupling in zip(root.all("coupling"), robot.couplings, strict=True):
        if not retargeted.keys().isdisjoint(coupling.servos):
            check_initial_sum(node, coupling, initial, _SOLVED, faults)


def _transforms(generic: Sequence[GenericServo]) -> list[Transform]:
    mapped = [joint for joint in generic if joint.servo is not None]
    coupled = [joint for joint in mapped if joint.transform == "coupled"]
    found: list[Transform] = [Linear([joint]) for joint in mapped if joint.transform == "linear"]
    found += [Table(joint) for joint in mapped if joint.table]
    if coupled and separable(coupled):
        found.append(Coupled(coupled))
    synergic = [joint for joint in mapped if joint.transform == "synergy" and joint.terms]
    if synergic:
        found.append(Synergy(synergic))
    return found


def _angles(transform: Transform, generic: Sequence[GenericServo]) -> dict[int, float]:
    """Returns the initial angles [rad] of the servos that `transform` moves, by the index of the servo.
    `generic` are the generic joints of the part."""
    initial = {joint.id: joint.initial for joint in generic}
    angles = np.array([initial[id] for id in transform.ids.tolist()])
    found = transform.robot(angles, np.zeros(len(angles)))
    return dict(zip(transform.servos.tolist(), found.tolist(), strict=True))


def _outside(servo: Servo, angle: float, slack: float) -> bool:
    lower, upper = servo.limits.lower, servo.limits.upper
    return lower is not None and upper is not None and not lower - slack <= angle <= upper + slack


def _where(servo: Servo, angle: float, how: str, node: Node) -> str:
    assert servo.limits.lower is not None
    assert servo.limits.upper is not None
    lower, upper = (in_unit(limit, node.unit) for limit in (servo.limits.lower, servo.limits.upper))
    return f"{in_unit(angle, node.unit)}{how}, outside its {lower} to {upper}"
