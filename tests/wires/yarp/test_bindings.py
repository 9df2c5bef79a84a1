"""YARP's own bindings instead of TCI's library: how they are selected, and tests that are possible without
them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tci
from tci.drivers.diagnosis import Level
from tci.errors import DriverError, MissingExtraError
from tci.wires.yarp.address import parse
from tci.wires.yarp.driver import YarpDriver
from yarpwire.bindings.module import reader, to_bottle
from yarpwire.bindings.network import Bindings
from yarpwire.errors import BindingsError, WireError
from yarpwire.values import Float32, Int8, Int16, Int64, Vocab


@pytest.fixture
def no_bindings(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "yarp", None)


@pytest.mark.usefixtures("no_bindings")
def test_without_bindings_the_error_says_how_to_get_them_and_what_works_without() -> None:
    for address in ("bindings", "127.0.0.1:9,bindings", "bindings,dialect=3"):
        advice = r"(?s)conda-forge.*CREATE_PYTHON.*PyPI.*leave out `bindings`"
        with pytest.raises(MissingExtraError, match=advice):
            tci.connect(tci.load_robot("nao"), f"yarp:{address}")
    (finding,) = YarpDriver.probe(tci.load_robot("nao"), "bindings")
    assert finding.level is Level.FAULT
    assert "conda" in finding.what


def test_another_package_of_that_name_is_not_taken_for_yarp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "yarp", raising=False)
    (tmp_path / "yarp.py").write_text("def parse(): pass\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(BindingsError, match=r"yarp\.py is another yarp"):
        Bindings()


def test_the_choice_is_a_word_of_the_address() -> None:
    assert parse("bindings").bindings
    assert parse("10.0.0.2:10000,bindings,robot=icubSim").server == ("10.0.0.2", 10000)
    assert parse("bindings,carrier=shmem").carrier == "shmem"
    assert not parse("10.0.0.2").bindings
    for wrong in ("carrier=shmem", "bindings,carrier=text", "bindings=1", "robot=icub,binding"):
        with pytest.raises(DriverError, match="then bindings, dialect="):
            parse(wrong)


class Noted:
    """Records the items that are added to a Bottle. Has the method names of YARP's Bottle."""

    def __init__(self) -> None:
        self.items: list[tuple[str, Any]] = []

    def addList(self) -> Noted:
        inner = Noted()
        self.items.append(("addList", inner.items))
        return inner

    def __getattr__(self, name: str) -> Callable[[Any], None]:
        return lambda value: self.items.append((name, value))


def test_each_type_goes_into_a_bottle_by_its_own_call() -> None:
    items = [Vocab("ok"), 1, 1 << 31, Int8(1), Int16(2), Int64(3), 2.5, Float32(0.5), "a", True, np.ones(2)]
    found = to_bottle(SimpleNamespace(Bottle=Noted), items).items
    assert found == [
        ("addVocab32", Vocab("ok")), ("addInt32", 1), ("addInt64", 1 << 31), ("addInt8", 1), ("addInt16", 2),
        ("addInt64", 3), ("addFloat64", 2.5), ("addFloat32", 0.5), ("addString", "a"),
        ("addVocab32", ord("1")), ("addList", [("addFloat64", 1.0), ("addFloat64", 1.0)]),
    ]  # fmt: skip
    assert {type(value) for _, value in found} <= {int, float, str, list}
    with pytest.raises(WireError, match="can't put"):
        to_bottle(SimpleNamespace(Bottle=Noted), [object()])


def test_what_fails_while_yarp_reads_ends_the_connection_and_not_the_program() -> None:
    def fail(connection: object) -> bool:
        raise RuntimeError("in a thread of YARP's")

    assert reader(SimpleNamespace(PortReader=object), fail).read(None) is False
