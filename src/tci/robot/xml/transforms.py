"""Reads and checks nonlinear transforms of generic servos: tables, couplings, retargeted shoulders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tci.robot.description import GenericServo, Term
from tci.robot.xml.document import Faults
from tci.robot.xml.node import Node, listed
from tci.robot.xml.servos import Servos

STEEPEST = 1e3
"""Largest slope between neighbouring points of a table. The least slope is 1 / STEEPEST. Assumed: real joints
are far inside these bounds, which also hold for the factor gamma of eq. 1."""
WORST = 1e4
"""Largest condition number of the matrix of a coupling. Assumed: with this condition number, rounding errors
stay far below the resolution of the sensors."""
SHOULDER = (0, 1, 2)
"""Indices, in the generic arm, of the three shoulder joints. The transform `retarget` converts their angles
together, since each angle of the robot's shoulder depends on all three."""


def read_table(node: Node, kind: str, faults: Faults) -> tuple[tuple[float, float], ...]:
    """Reads the table of a generic joint: pairs (servo angle, generic angle) [rad], in rising order of the
    servo angle."""
    table = node.first("transform_table")
    if kind != "table":
        if table is not None:
            faults.add(table.line, f"transform_table is for the transform_type table, not {kind}")
        return ()
    if table is None:
        faults.add(node.line, "the transform_type table needs a transform_table")
        return ()
    _no_factors(node, kind, faults)
    points = [point for point in table.all("point") if point.ok and len(point.values) >= 2]
    pairs = tuple((point.get("robot"), point.get("generic")) for point in points)
    if len(pairs) < 2:
        faults.add(table.line, f"a transform_table of {len(pairs)} points; valid: at least 2")
        return ()
    robot, generic = np.diff(pairs, axis=0).T
    for point, run, rise in zip(points[1:], robot, generic, strict=True):
        if run <= 0.0:
            faults.add(point.line, "the robot's angles of a transform_table must rise from point to point")
        elif rise * generic[0] <= 0.0 or not 1.0 / STEEPEST <= abs(rise / run) <= STEEPEST:
            faults.add(
                point.line,
                "the generic angles of a transform_table must all rise or all fall, "
                f"with a slope of {1.0 / STEEPEST:g} to {STEEPEST:g}",
            )
        else:
            continue
        return ()
    return pairs


def read_terms(part: Node, node: Node, kind: str, servos: Servos, faults: Faults) -> tuple[Term, ...]:
    """Reads the `coupled_term` elements of a generic joint whose angle is a weighted sum of servo angles: the
    servos and their factors."""
    children = node.all("coupled_term")
    if kind not in ("coupled", "synergy"):
        if children:
            valid = "coupled and synergy"
            faults.add(children[0].line, f"coupled_term is for the transform_types {valid}, not {kind}")
        return ()
    if not children and not node.misspelt:
        faults.add(node.line, f"the transform_type {kind} needs at least one coupled_term")
    if factor := node.first("transform_factor"):
        faults.add(
            factor.line, f"a generic servo of type {kind} has factors in its coupled_term elements only"
        )
    terms: dict[int, Term] = {}
    for child in children:
        if not child.ok or "destination_servo_id" not in child.values:
            continue
        robot_part = child.get("robot_part") or part.get("robot_part") or part.get("name", "?")
        servo = servos.find(robot_part, child.get("destination_servo_id"), child.line, faults)
        if servo is not None and servo.index in terms:
            faults.add(child.line, f"servo {servo.id} {servo.name!r} has a coupled_term here already")
        elif servo is not None:
            terms[servo.index] = Term(servo=servo.index, factor=child.get("factor"))
    return tuple(terms.values())


def check_coupled(node: Node, generic: Sequence[GenericServo], faults: Faults) -> None:
    """Checks the coupled joints of a part, whose angles are weighted sums of servo angles. The sums may
    contain only the servos that the file assigns to these joints, and the matrix of the weights must be
    invertible."""
    coupled = [joint for joint in generic if joint.transform == "coupled" and joint.servo is not None]
    own = [joint.servo for joint in coupled]
    for joint in coupled:
        if any(term.servo not in own for term in joint.terms):
            faults.add(
                node.line,
                f"generic servo {joint.id} is coupled with a servo that is no coupled joint's "
                "destination_servo_id in this part",
            )
            return
    if coupled and not separable(coupled):
        ids = listed(str(joint.id) for joint in coupled)
        faults.add(node.line, f"the coupled generic servos {ids} can't be told apart: singular matrix")


def check_synergy(node: Node, generic: Sequence[GenericServo], faults: Faults) -> None:
    """Checks that each joint with the transform `synergy` has its own servo (`destination_servo_id`) among
    its `coupled_terms`. Also checks that no joint with another transform has a servo of these terms as its
    own."""
    synergic = [joint for joint in generic if joint.transform == "synergy" and joint.servo is not None]
    moved = {term.servo for joint in synergic for term in joint.terms}
    for joint in synergic:
        if node.ok and joint.terms and all(term.servo != joint.servo for term in joint.terms):
            faults.add(
                node.line, f"generic servo {joint.id}: none of its coupled_terms is its destination_servo_id"
            )
    for joint in generic:
        if joint.transform != "synergy" and joint.servo in moved:
            faults.add(
                node.line, f"generic servo {joint.id} leads to a servo of a synergy, and has no part in it"
            )


def separable(coupled: Sequence[GenericServo]) -> bool:
    """Returns True if a part's angles can be converted back to servo angles. Each of the joints `coupled` is
    a weighted sum of servo angles. The sums must contain no servos except those that are assigned to these
    joints, and the matrix of the weights must be invertible. `coupled` contains at least one joint."""
    own = [joint.servo for joint in coupled]
    if any(term.servo not in own for joint in coupled for term in joint.terms):
        return False
    matrix = np.zeros((len(own), len(own)))
    for row, joint in enumerate(coupled):
        for term in joint.terms:
            matrix[row, own.index(term.servo)] = term.factor
    return bool(np.linalg.cond(matrix) <= WORST)


def check_retarget(node: Node, kind: str, generic: Sequence[GenericServo], faults: Faults) -> None:
    """Checks that retargeting is used only for all three shoulder joints together, in an arm that has an
    elbow and both segments."""
    ids = tuple(joint.id for joint in generic if joint.transform == "retarget")
    if not ids:
        return
    if kind != "arm" or ids != SHOULDER or any(joint.servo is None for joint in generic[:4]):
        faults.add(
            node.line,
            f"retarget on generic servos {listed(map(str, ids))} of a {kind}; valid: 0, 1 and 2 of an arm "
            "that has servos for these and its elbow",
        )
    if {segment.get("name") for segment in node.all("segment")} < {"upper_arm", "forearm"}:
        faults.add(node.line, "a retargeted arm needs the segments upper_arm and forearm")
    for child in node.all("generic_servo"):
        if child.value("transform_type") == "retarget":
            _no_factors(child, "retarget", faults)


def _no_factors(node: Node, kind: str, faults: Faults) -> None:
    for tag in ("transform_factor", "transform_displacement"):
        if child := node.first(tag):
            faults.add(child.line, f"{tag} is not for the transform_type {kind}")
