"""A driver that wraps another driver behaves like the wrapped driver, except for its changes. The constructor
of every driver calls its base class."""

from __future__ import annotations

import ast
import os
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

import tci
from helpers import ROOT
from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver, NativePart
from tci.drivers.info import DriverInfo
from tci.drivers.lease import held
from tci.drivers.wrapper import DriverWrapper
from tci.gate.gate import SafeCommand
from tci.messages import JointReading, ManualClock, Reading
from tci.robot.joint_map import initial_position

FOUND = (Finding(Level.NOTE, "dialect", "4.0"),)
CLASSMETHODS = {"load_library", "probe"}
"""Members of a driver class that are called before a driver exists."""
BASES = {"Driver", "RemoteDriver", "RosDriver", "SimulatedDriver", "DriverWrapper"}


class Told(Driver):
    """A driver that records each call and returns other values than its base class."""

    def __init__(self) -> None:
        super().__init__(
            DriverInfo.of(
                tci.load_robot("nao"), "sim", clock=ManualClock(1.0), armed=True,
                lease_name=f"sim:nao:{os.getpid()}:{id(self)}",
            )
        )  # fmt: skip
        self.calls: list[str] = []
        here = np.array(initial_position(self.robot))
        self.reading = Reading(JointReading(1.0, 1, here, np.zeros(len(here))), ())
        self.part = NativePart("named anew", self.robot.servos[:1])

    def ticks(self, *, duration: float | None = None, start: float | None = None) -> Iterator[float]:
        self.calls.append(f"ticks {duration} {start}")
        return iter((5.0, 7.0))

    def diagnose(self) -> tuple[Finding, ...]:
        return FOUND

    def native(self, robot_part: str) -> NativePart:
        return self.part

    def _receive(self) -> Reading:
        self.calls.append("receive")
        return self.reading

    def _send(self, safe: SafeCommand) -> None:
        self.calls.append("send")

    def _halt(self) -> None:
        self.calls.append("halt")

    def _close(self) -> None:
        self.calls.append("close")


def written(driver: Driver, told: Told) -> bool:
    safe = driver.gate.step((), told.reading.joints, 1.0)
    return driver.write(safe) is safe and told.calls == ["send"]


def commanded(driver: Driver, told: Told) -> bool:
    with driver.commanding():
        taken = held(told.info.lease_name)
    return taken is not None and held(told.info.lease_name) is None


FORWARDED: dict[str, Callable[[Driver, Told], bool]] = {
    "robot": lambda driver, told: driver.robot is told.robot,
    "clock": lambda driver, told: driver.clock is told.clock,
    "gate": lambda driver, told: driver.gate is told.gate,
    "period": lambda driver, told: driver.period == told.period,
    "armed": lambda driver, told: driver.armed is True,
    "read": lambda driver, told: driver.read() is told.reading,
    "write": written,
    "halt": lambda driver, told: driver.halt() is None and told.calls == ["halt"],
    "close": lambda driver, told: driver.close() is None and told.calls == ["close"],
    "ticks": lambda driver, told: (
        [*driver.ticks(duration=2.0, start=3.0)] == [5.0, 7.0] and told.calls == ["ticks 2.0 3.0"]
    ),
    "diagnose": lambda driver, told: driver.diagnose() is FOUND,
    "native": lambda driver, told: driver.native("any") is told.part,
    "commanding": commanded,
}
"""For each public member of a driver with a connection: a check that a wrapper passes the call on."""


def test_each_member_of_a_driver_has_its_check() -> None:
    public = {name for name in dir(Driver) if not name.startswith("_")}
    assert public - CLASSMETHODS == set(FORWARDED)
    hidden = {name for name in vars(Driver) if name.startswith("_") and callable(getattr(Driver, name))}
    own = {
        "_check_open",
        "_leased",
        "_may_write",
        "_release",
        *(name for name in hidden if name.startswith("__")),
        "_abc_impl",
    }
    assert hidden - own <= set(vars(DriverWrapper))


@pytest.mark.parametrize("depth", [1, 2])
@pytest.mark.parametrize("member", FORWARDED)
def test_a_wrapper_forwards_each_member(member: str, depth: int) -> None:
    told = Told()
    driver: Driver = told
    for _ in range(depth):
        driver = DriverWrapper(driver)
    assert FORWARDED[member](driver, told)


def test_a_wrapper_has_the_facts_of_the_inner_driver_but_those_that_it_changes() -> None:
    told = Told()
    wrapped = DriverWrapper(told, keep_alive=0.5)
    assert wrapped.info.keep_alive == 0.5
    for field in fields(DriverInfo):
        if field.name != "keep_alive":
            assert getattr(wrapped.info, field.name) is getattr(told.info, field.name), field.name
    unarmed = DriverWrapper(told, armed=False)
    with pytest.raises(tci.TciError, match="read-only"):
        unarmed.write(unarmed.gate.step((), told.reading.joints, 1.0))
    assert told.calls == []


def calls_base(init: ast.FunctionDef) -> bool:
    """Returns True if a constructor calls the constructor of its base class."""
    return any(
        isinstance(node, ast.Call) and ast.unparse(node.func) == "super().__init__" for node in ast.walk(init)
    )


def skips(source: str) -> list[str]:
    """Returns the names of the drivers in a module whose constructor does not call `Driver.__init__`."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef) and {ast.unparse(base) for base in node.bases} & BASES:
            inits = [one for one in node.body if isinstance(one, ast.FunctionDef) and one.name == "__init__"]
            found += [node.name for init in inits if not calls_base(init)]
    return found


def subclasses(kind: type[Any]) -> set[type[Any]]:
    """Returns all imported subclasses of `kind`, direct and indirect."""
    return {one for sub in kind.__subclasses__() for one in (sub, *subclasses(sub))}


def test_no_driver_skips_the_constructor_of_its_base_class() -> None:
    assert skips("class Bare(Driver):\n    def __init__(self, robot):\n        self.robot = robot") == [
        "Bare"
    ]
    files = [path for folder in ("src", "tests", "tools") for path in (ROOT / folder).rglob("*.py")]
    assert sum("Driver)" in path.read_text() for path in files) > 15
    assert {path.name: found for path in files if (found := skips(path.read_text()))} == {}


def test_the_scan_knows_each_class_that_drivers_derive_from() -> None:
    from tci.drivers.registry import driver_names, load_driver
    from tci.lab.faults.fault_injector import FaultInjector

    for name in driver_names():
        try:
            load_driver(name)
        except tci.TciError:
            continue
    known = {kind for kind in subclasses(Driver) if kind.__module__.startswith("tci.")}
    assert FaultInjector in known
    assert {base.__name__ for kind in known for base in kind.__bases__} <= BASES | {"ABC"}
