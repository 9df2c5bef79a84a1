"""What is typed while a robot runs."""

from __future__ import annotations

import os
import pty
import sys
from collections.abc import Iterator

import pytest

import tci
from helpers.desk import Desk
from tci.cli.operator import Operator
from tci.cli.serve import serve
from tci.drivers import registry
from tci.gate.gate import GateState


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """The end of a terminal at which a person types; the input of this process is the other end."""
    person, program = pty.openpty()
    with os.fdopen(program) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        yield person
    os.close(person)


def test_reset_and_free_are_carried_out_or_told(keyboard: int) -> None:
    with tci.connect("nao") as driver:
        operator = Operator(driver.gate)
        assert operator.present
        assert operator.listen() == []
        driver.gate.stop("a test")
        os.write(keyboard, b"reset\nfree\nJump\n")
        said: list[str] = []
        while len(said) < 3:
            said += operator.listen()
        assert said[0] == "reset by the operator"
        assert "refused: nothing is in contact" in said[1]
        assert "'jump' is unknown; valid: reset, free" in said[2]
        tick = driver.read().joints.stamp
        assert driver.gate.step((), driver.read().joints, tick).state is GateState.RUN


def test_a_served_robot_tells_what_was_typed(
    keyboard: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "open_server", lambda driver, via: Desk(driver, {}))
    os.write(keyboard, b"free\n")
    serve("nao", via="desk", source="sim", duration=0.3)
    assert "free is refused: nothing is in contact" in capsys.readouterr().out


def test_no_terminal_is_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    with os.fdopen(reading) as pipe, os.fdopen(writing, "w") as end, tci.connect("nao") as driver:
        monkeypatch.setattr(sys, "stdin", pipe)
        end.write("reset\n")
        end.flush()
        operator = Operator(driver.gate)
        assert not operator.present
        assert operator.listen() == []
