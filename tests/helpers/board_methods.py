"""Methods of the remote control board interfaces, as YARP's clients call them. Writes the page that shows the
answer of a served board to each method.

python -m helpers.board_methods (in `tests/`)

writes the page.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import Any

import numpy as np

import tci
from helpers import ROOT
from tci.messages import JointReading
from tci.wires.yarp.served_board import ServedBoard
from yarpwire.calls_v3 import answer_v3
from yarpwire.calls_v4 import answer_v4
from yarpwire.dialect import V3, V4, Dialect
from yarpwire.errors import CallError
from yarpwire.text import from_text
from yarpwire.values import Vocab

PAGE = ROOT / "docs" / "tables" / "yarp-methods.md"
DATA = ROOT / "tests" / "yarpwire" / "data"
OK = Vocab("ok")
JOINTS = 16
SAMPLES: dict[str, Any] = {
    "i32": 3, "i16": 3, "f64": 0.05, "bool": Vocab("ok"), "str": "x",
    "i32s": [0, 3], "lists": [], "bottle": [],
    "pidtype": int(Vocab("pos")), "stiff": int(Vocab("stif")), "mode": int(Vocab("pos")),
}  # fmt: skip


class Unattended(ServedBoard):
    """A board without a control loop. An accepted call counts as executed."""

    def awaited(self) -> AbstractContextManager[None]:
        return nullcontext()


def board() -> Unattended:
    """Returns the left arm of an iCub, at rest."""
    robot = tci.load_robot("icub")
    shown = Unattended("left_arm", robot.servos_of("left_arm"))
    zeros = np.zeros(len(robot.servos))
    reading = JointReading(stamp=0.0, sequence=1, position=zeros, velocity=zeros, torque=zeros)
    shown.update(reading, [servo.modes[0] for servo in robot.servos])
    return shown


def _sections(name: str) -> Iterator[tuple[str, str]]:
    interface = ""
    for line in (DATA / f"control_board_{name}.txt").read_text().splitlines():
        if line.startswith("[") and line.endswith("]") and " " not in line:
            interface = line[1:-1]
        elif line and not line.startswith("#"):
            yield interface, line


def calls_v3() -> Iterator[tuple[str, str, list[Any]]]:
    """Yields interface, method and call of each method of 3.12."""
    whole = {"(n)": [0.5] * JOINTS, "(w)": [Vocab("pos")] * JOINTS, "(s)": [Vocab("stif")] * JOINTS}
    for interface, line in _sections("3.12"):
        method, _, call = line.partition(" ")
        ending = call.rpartition(" ")[2]
        items = [*from_text(call.removesuffix(ending)), whole[ending]] if ending in whole else from_text(call)
        yield interface, method, items


def calls_v4(joint: int = 3) -> Iterator[tuple[str, str, list[Any], list[str]]]:
    """Yields interface, method, call and types of the returned fields of each method of 4.0."""
    for interface, line in _sections("4.0"):
        head, _, fields = line.partition("->")
        method, *types = head.split()
        group = "i32s" in types
        sizes = {"f64s": [0.05], "stiffs": [int(Vocab("stif"))], "modes": [int(Vocab("pos"))]}
        samples = SAMPLES | {kind: one * (2 if group else JOINTS) for kind, one in sizes.items()}
        samples |= {"i32": joint, "i16": joint, "i32s": [0, joint]}
        yield interface, method, [f"{method}RPC", *(samples[kind] for kind in types)], fields.split()


def is_answered(reply: Any, dialect: Dialect) -> bool:
    """Returns True if a reply says that the call was executed."""
    return bool(reply[-1] == OK) if dialect is V3 else reply[0] in (OK, [OK])


def _prepare(shown: Unattended, interface: str) -> None:
    """Switches joints to the control mode that the methods of an interface need."""
    mode = {"IPositionDirect": "posd", "IVelocityControl": "vel", "IVelocityDirect": "veld"}.get(interface)
    mode = "torq" if interface == "ITorqueControl" else mode or "pos"
    for joint in range(JOINTS):
        with suppress(CallError):  # fingers have no torque mode
            shown.set_modes([joint], [Vocab(mode)])


def page() -> str:
    """Returns a table of the methods that are executed and of the methods that are refused, by interface and
    dialect."""
    found: dict[str, dict[tuple[str, bool], dict[str, None]]] = {}
    shown = board()
    for interface, method, call in calls_v3():
        _prepare(shown, interface)
        place = V3.name, is_answered(answer_v3(shown, call), V3)
        found.setdefault(interface, {}).setdefault(place, {})[method] = None
    for interface, method, call, _ in calls_v4():
        _prepare(shown, interface)
        place = V4.name, is_answered(answer_v4(shown, call), V4)
        name = re.sub("(One|Group|All)$", "", method)
        found.setdefault(interface, {}).setdefault(place, {})[name] = None
    lines = ["| interface | reply | methods in 3.12 | methods in 4.0 |", "|---|---|---|---|"]
    for interface in sorted(found):
        for kind, answered in (("answered", True), ("refused", False)):
            cells = [", ".join(found[interface].get((name, answered), ())) for name in (V3.name, V4.name)]
            if any(cells):
                lines.append(f"| {interface} | {kind} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page())
