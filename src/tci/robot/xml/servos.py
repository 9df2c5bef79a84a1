"""Reader of the elements `robot_part`, `servo` and `coupling`: the robot's own joints."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from tci.messages import Mode
from tci.robot.description import Coupling, Limits, Mimic, Servo
from tci.robot.xml.document import Faults
from tci.robot.xml.grammar import LIMITS
from tci.robot.xml.node import Node, listed, nearest
from tci.robot.xml.values import in_unit

Key = tuple[str, int]
"""Robot part and id, which together identify a servo in a file."""

_RADIANS_LIKE = math.radians(2.0 * math.pi)
"""Angle of 6.28 degrees [rad]. If a file is in degrees and no limit is larger than this angle, the limits
were probably written in radians, in which 6.28 (2 pi) is a full turn."""


class Servos:
    """The servos of a robot, and their line numbers in the file."""

    def __init__(self, declared: bool) -> None:
        self.declared = declared
        """True if the file declares its servos in elements `robot_part`. If False, the servos are those to
        which the generic parts refer."""
        self.all: list[Servo] = []
        self.line: dict[int, int] = {}
        """Line number of each servo, by its index."""
        self.unknown: set[str] = set()
        """Robot parts that have a servo with an unreadable id."""
        self._index: dict[Key, int] = {}

    def add(self, line: int, robot_part: str, id: int, **fields: Any) -> None:
        """Adds a servo with the next index."""
        index = len(self.all)
        self._index[robot_part, id] = index
        self.line[index] = line
        self.all.append(Servo(index=index, robot_part=robot_part, id=id, **fields))

    @property
    def robot_parts(self) -> tuple[str, ...]:
        """Names of the robot's own parts."""
        return tuple(dict.fromkeys(part for part, _ in self._index))

    def find(self, robot_part: str, id: int, line: int, faults: Faults) -> Servo | None:
        """Returns the servo that has the number `id` in the robot part named `robot_part`. If this robot part
        has no such servo, returns None and records a fault on `line`.

        If this robot part has a servo with an unreadable id, that servo may be the requested one. In this
        case, no fault is recorded.
        """
        if (robot_part, id) in self._index:
            return self.all[self._index[robot_part, id]]
        if {robot_part, NAMELESS} & self.unknown:
            return None
        if robot_part not in self.robot_parts:
            faults.add(line, f"no robot_part named {robot_part!r}{nearest(robot_part, self.robot_parts)}")
        else:
            valid = listed(f"{s.id} {s.name}" for s in self.all if s.robot_part == robot_part)
            faults.add(line, f"robot_part {robot_part!r} has no servo {id}; valid: {valid}")
        return None


NAMELESS = "?"
"""Name in messages for an element with an unreadable name."""


def once_only(nodes: Iterable[Node], key: str, what: str, faults: Faults) -> list[Node]:
    """Returns those `nodes` whose attribute `key` has a value that no earlier node has. Each other node is
    left out and recorded as a fault."""
    first: dict[Any, Node] = {}
    kept = []
    for node in nodes:
        value = node.get(key)
        if value is not None and value in first:
            faults.add(node.line, f"second {what} {key} {value!r}; the first is on line {first[value].line}")
            continue
        first[value] = node
        kept.append(node)
    return kept


def read_servos(root: Node, faults: Faults) -> Servos:
    """Reads all servos of a file. The servos of one robot part are sorted by id."""
    servos = Servos(declared=bool(root.all("robot_part")))
    if not servos.declared:
        _mentioned(root, servos)
        return servos
    nodes: list[tuple[str, Node]] = []
    modes = {}
    for part in once_only(root.all("robot_part"), "name", "robot_part with", faults):
        name = part.get("name", NAMELESS)
        modes[name] = part.get("modes", (Mode.POSITION.value,))
        what = f"servo of robot_part {name!r} with"
        of_part = once_only(part.all("servo"), "id", what, faults)
        if name == NAMELESS or not all("id" in node.values for node in of_part):
            servos.unknown.add(name)
        once_only(of_part, "name", what, faults)
        nodes += [(name, node) for node in sorted(of_part, key=lambda node: node.get("id", -1))]
    driven = [
        one
        for _, node in nodes
        for one in (node, *node.all("mimic"), *node.all("slide"))
        if "joint" in one.values
    ]
    once_only(driven, "joint", "servo with", faults)
    for name, node in nodes:
        if "id" in node.values:
            fields = {"name": "?"} | node.fields
            own = tuple(map(Mode, node.get("modes", modes[name])))
            mimics = tuple(Mimic(**child.fields) for child in node.all("mimic") if child.ok)
            mimics += tuple(Mimic(**child.fields, slides=True) for child in node.all("slide") if child.ok)
            servos.add(node.line, name, **fields, limits=_limits(node, faults), modes=own, mimics=mimics)
    _check_unit(root, servos, faults)
    return servos


def read_couplings(
    root: Node, servos: Servos, initial: Mapping[int, float], faults: Faults
) -> tuple[Coupling, ...]:
    """Reads the couplings of a file. `initial` contains the initial angles [rad] of servos by index, if they
    are known."""
    couplings = []
    for node in once_only(root.all("coupling"), "name", "coupling with", faults):
        name = node.get("name", "?")
        found: dict[int, float] = {}
        for term in node.all("term"):
            if "robot_part" not in term.values or "servo" not in term.values:
                continue
            servo = servos.find(term.get("robot_part"), term.get("servo"), term.line, faults)
            if servo is not None and servo.index in found:
                faults.add(term.line, f"coupling {name!r} names servo {servo.name!r} twice")
            elif servo is not None:
                found[servo.index] = term.get("coefficient", 1.0)
        if not node.ok or len(found) != len(node.all("term")):
            continue
        coupling = Coupling(**node.fields, servos=tuple(found), coefficients=tuple(found.values()))
        _check_coupling(node, coupling, servos, initial, faults)
        couplings.append(coupling)
    return tuple(couplings)


def _mentioned(root: Node, servos: Servos) -> None:
    """Adds to `servos` the servos that the generic parts of a file name, without limits. This function is for
    files that do not list their servos in elements `robot_part`, such as Listing 2."""
    mentioned: dict[Key, int] = {}
    for part in root.all("generic_robot_part"):
        for node in part.all("generic_servo"):
            target = node.first("destination_servo_id")
            if target is not None and isinstance(target.text, int):
                robot_part = target.get("robot_part") or part.get("robot_part") or part.get("name", "?")
                mentioned.setdefault((robot_part, target.text), target.line)
    parts = list(dict.fromkeys(part for part, _ in mentioned))
    for robot_part, id in sorted(mentioned, key=lambda key: (parts.index(key[0]), key[1])):
        servos.add(mentioned[robot_part, id], robot_part, id, name=f"servo{id}")


def _limits(node: Node, faults: Faults) -> Limits:
    figures: dict[str, float] = {}
    assumed: list[str] = []
    for tag in LIMITS:
        limit = node.first(tag)
        if limit is None or not limit.ok:
            continue
        if tag != "position" or check_range(limit, f"position of servo {node.get('name', '?')!r}", faults):
            figures |= limit.fields
            assumed += limit.fields if limit.get("origin") == "assumed" else []
    return Limits(**figures, assumed=tuple(assumed))


def check_range(node: Node, what: str, faults: Faults) -> bool:
    """Returns True if the angle `min` of the node is below the angle `max`. Otherwise, records a fault."""
    lower, upper = node.get("min"), node.get("max")
    if lower < upper:
        return True
    lower, upper = in_unit(lower, node.unit), in_unit(upper, node.unit)
    faults.add(node.line, f"{what}: min {lower} must be below max {upper}; they are not swapped for you")
    return False


def _check_unit(root: Node, servos: Servos, faults: Faults) -> None:
    """Records a fault if the limits in a file with angle_unit="deg" are probably in radians, because none of
    them is larger than 6.28."""
    ranges = [
        (node.first("position"), servos.line) for part in root.all("robot_part") for node in part.all("servo")
    ]
    positions = [position for position, _ in ranges if position is not None and position.ok]
    if len(positions) >= 3 and all(
        position.unit == "deg" and max(-position.get("min"), position.get("max")) <= _RADIANS_LIKE
        for position in positions
    ):
        faults.add(
            root.line,
            "every position limit in this file is below 6.3 deg: they look like radians; "
            'valid: angle_unit="rad", or type="rad" where an element is in radians',
        )


def _check_coupling(
    node: Node, coupling: Coupling, servos: Servos, initial: Mapping[int, float], faults: Faults
) -> None:
    if not check_range(node, f"coupling {coupling.name!r}", faults):
        return
    bounds = f"{in_unit(coupling.lower, node.unit)} to {in_unit(coupling.upper, node.unit)}"
    terms = list(zip(coupling.servos, coupling.coefficients, strict=True))
    reach = [0.0, 0.0]
    for index, coefficient in terms:
        limits = servos.all[index].limits
        if limits.lower is None or limits.upper is None:
            break
        ends = sorted((coefficient * limits.lower, coefficient * limits.upper))
        reach = [reach[0] + ends[0], reach[1] + ends[1]]
    else:
        if reach[0] > coupling.upper or reach[1] < coupling.lower:
            span = f"{in_unit(reach[0], node.unit)} to {in_unit(reach[1], node.unit)}"
            faults.add(
                node.line,
                f"coupling {coupling.name!r} can never hold: the limits of its servos give {span}, "
                f"it asks for {bounds}",
            )
            return
    if all(index in initial for index in coupling.servos):
        check_initial_sum(node, coupling, initial, 1e-9, faults)


def check_initial_sum(
    node: Node, coupling: Coupling, initial: Mapping[int, float], slack: float, faults: Faults
) -> None:
    """Checks that a coupling is satisfied in the initial posture.

    `initial` contains the initial angles [rad] by servo index. The tolerance of the check is `slack` [rad].
    """
    total = sum(c * initial[index] for index, c in zip(coupling.servos, coupling.coefficients, strict=True))
    if not coupling.lower - slack <= total <= coupling.upper + slack:
        faults.add(
            node.line,
            f"the initial positions break coupling {coupling.name!r}: their sum is "
            f"{in_unit(total, node.unit)}, valid: {in_unit(coupling.lower, node.unit)} to "
            f"{in_unit(coupling.upper, node.unit)}",
        )
