"""Query of a robot's facts on YARP: a port that answers calls with DH tables, limits and skin of the robot.

A person can type the calls (`echo 'dh left_arm' | yarp rpc /icub/facts/rpc:i`). A program reads all facts at
once as JSON with `read_robot_facts`. Lengths are in [m], angles in [rad].
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from tci.errors import DriverError, TciError
from tci.exports.facts import CONVENTIONS, RobotFacts, query, read_facts
from tci.robot.description import Robot
from tci.wires.yarp import address as addresses
from tci.wires.yarp.driver_errors import raises_driver_errors
from yarpwire.dialect import V3
from yarpwire.values import Vocab

PATIENCE = 30.0
"""Longest time [s] that `read_robot_facts` waits for the robot's answer. Assumed: this is enough for the
first query, for which the robot's process fits cones to all skin."""
USAGE = {
    "help": "list of the calls",
    "json": "everything as JSON, in the format tci.robot/1",
    "limits": "(name lower upper speed torque) of each servo; nan for an unknown one",
    "dh PART [classic|modified]": "(servo a alpha d theta) of each joint from the torso",
    "skins": "(patch part segment link channels area) of each patch",
    "taxels PATCH": "(channel x y z nx ny nz area) of each taxel, in the patch's link",
    "points": "(part point frame speed) of each Cartesian actuator; nan for no limit of speed",
}
FAIL, NAN = Vocab("fail"), float("nan")


class FactsService:
    """Answers calls about one robot. Each connection calls `answer` in a thread of its own."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._lock = threading.Lock()

    @cached_property
    def _facts(self) -> RobotFacts:
        return query(self._robot)

    def answer(self, items: Sequence[Any]) -> list[Any]:
        """Returns the data that a call requests, or `[fail]` and a text with the valid calls."""
        words = [item.word if isinstance(item, Vocab) else str(item) for item in items]
        kinds: dict[str, Callable[..., list[Any]]] = {
            "help": lambda: [Vocab("many"), *(f"{call}: {what}" for call, what in USAGE.items())],
            "json": lambda: [self._facts.model_dump_json()],
            "limits": self._limits, "dh": self._dh, "skins": self._skins, "taxels": self._taxels,
            "points": self._points,
        }  # fmt: skip
        try:
            with self._lock:
                return kinds[words[0]](*words[1:])
        except TciError as error:
            return [FAIL, str(error)]
        except (LookupError, TypeError):
            return [FAIL, f"{' '.join(words)[:80]!r} is not known; valid: {', '.join(USAGE)}"]

    def _limits(self) -> list[Any]:
        found = [(s.name, s.limits) for s in self._facts.servos]
        return [
            [name, *(NAN if value is None else value for value in (x.lower, x.upper, x.velocity, x.torque))]
            for name, x in found
        ]

    def _dh(self, part: str, convention: str = CONVENTIONS[0]) -> list[Any]:
        tables = {(table.part, table.convention): table for table in self._facts.denavit_hartenberg}
        for place, table in tables.items():
            if place == (part, convention):
                return [[row.servo, row.a, row.alpha, row.d, row.theta] for row in table.rows]
        valid = ", ".join(f"{name} {kind}" for name, kind in tables)
        raise DriverError(f"no DH table of {part} {convention}; valid: {valid or '(none)'}")

    def _skins(self) -> list[Any]:
        return [[p.name, p.part, p.segment, p.link, p.channels, p.area] for p in self._facts.patches]

    def _points(self) -> list[Any]:
        found = [(part.name, one) for part in self._facts.parts for one in part.cartesian]
        return [[part, x.name, x.frame, NAN if x.speed is None else x.speed] for part, x in found]

    def _taxels(self, patch: str) -> list[Any]:
        for one in self._facts.patches:
            if one.name == patch:
                return [[t.channel, *t.position, *t.normal, t.area] for t in one.taxels]
        valid = ", ".join(one.name for one in self._facts.patches)
        raise DriverError(f"no patch {patch}; valid: {valid or '(none)'}")


@raises_driver_errors
def read_robot_facts(robot: str, address: str = "") -> RobotFacts:
    """Reads all facts of a served robot. docs/yarp.md describes the `address`.

    Raises DriverError if the robot is not served or does not answer, DescriptionError if the answer is
    invalid.
    """
    options = addresses.parse(address)
    network = options.network()
    name = facts_port(options.robot or robot)
    dialect = options.dialect or network.dialect or V3
    caller = network.caller(network.query(name), f"/tci/{os.getpid()}/facts:o", dialect)
    try:
        said = caller.call("json", patience=PATIENCE)
    finally:
        caller.close()
    if len(said) != 1 or not isinstance(said[0], str):
        raise DriverError(f"{name} answers {str(said)[:80]}; valid: one text of JSON")
    return read_facts(said[0])


def facts_port(prefix: str) -> str:
    """Returns the name of the port that answers questions about the robot."""
    return f"/{prefix}/facts/rpc:i"
