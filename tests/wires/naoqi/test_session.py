"""Addresses, credentials and error messages."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.served import needs_qi
from helpers.still_nao import Doorman, StillNao
from tci.drivers.diagnosis import Level
from tci.drivers.registry import connect, load_driver
from tci.errors import DriverError
from tci.robot.catalogue import load_robot

needs_qi()

from tci.wires.naoqi.session import PASSWORD, Address, open_session, parse_address


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("//10.0.0.5", "tcp://10.0.0.5:9559"),
        ("10.0.0.5", "tcp://10.0.0.5:9559"),
        ("nao.local:9600", "tcp://nao.local:9600"),
        ("//nao@10.0.0.5", "tcps://10.0.0.5:9503"),
        ("//nao@10.0.0.5:9504", "tcps://10.0.0.5:9504"),
        ("//[fe80::1]", "tcp://[fe80::1]:9559"),
    ],
)
def test_addresses(text: str, url: str) -> None:
    assert parse_address(text).url == url


@pytest.mark.parametrize(
    "text", ["", "//", "//10.0.0.5:port", "//10.0.0.5:99999", "//10.0.0.5/path", "//10.0.0.5?life=maybe",
             "//10.0.0.5?pepper=1", "//10.0.0.5#x"],
)  # fmt: skip
def test_other_addresses_are_refused_with_those_that_are_valid(text: str) -> None:
    with pytest.raises(DriverError, match="valid"):
        parse_address(text)


def test_a_password_on_the_command_line_is_refused_and_not_repeated() -> None:
    with pytest.raises(DriverError, match=PASSWORD) as caught:
        parse_address("//nao:secret@10.0.0.5")
    assert "secret" not in str(caught.value)


def test_nobody_there_a_service_that_is_missing_and_a_port_that_is_none_of_naoqis() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(DriverError, match="check that the robot is on"):
        open_session(Address("127.0.0.1", port))
    with StillNao(without=("ALMotion",)) as nao, pytest.raises(DriverError, match="no service ALMotion"):
        connect(load_robot("nao"), nao.via)
    with socket.create_server(("127.0.0.1", 0)) as silent, pytest.raises(DriverError, match=r"NAOqi 2\.9"):
        open_session(Address("127.0.0.1", silent.getsockname()[1]), timeout=0.3)


@pytest.fixture
def doorman(tmp_path: Path) -> Iterator[Doorman]:
    with StillNao() as nao:
        door = Doorman(nao, "nao", "open sesame", tmp_path)
        yield door
        door.close()


def test_the_credentials_of_29_open_the_door_over_tls(
    doorman: Doorman, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PASSWORD, "open sesame")
    with connect(load_robot("nao"), f"naoqi://nao@127.0.0.1:{doorman.port}") as driver:
        assert driver.read().joints.position.shape == (14,)
    assert doorman.refused == 0


def test_wrong_credentials_and_none_are_told_without_the_password(
    doorman: Doorman, monkeypatch: pytest.MonkeyPatch
) -> None:
    via = f"naoqi://nao@127.0.0.1:{doorman.port}"
    monkeypatch.setenv(PASSWORD, "open barley")
    with pytest.raises(DriverError, match="check the user name and") as caught:
        connect(load_robot("nao"), via)
    assert "barley" not in str(caught.value)
    assert doorman.refused == 1
    monkeypatch.delenv(PASSWORD)
    with pytest.raises(DriverError, match="is missing; valid: set"):
        connect(load_robot("nao"), via)


def test_probe_names_the_step_that_fails() -> None:
    robot = load_robot("nao")
    with StillNao() as nao:
        assert [step.level for step in load_driver("naoqi").probe(robot, f"//127.0.0.1:{nao.port}")] == [
            Level.OK, Level.OK,
        ]  # fmt: skip
        port = nao.port
    (gone,) = load_driver("naoqi").probe(robot, f"//127.0.0.1:{port}")
    assert (gone.subject, gone.level) == ("network", Level.FAULT)
    with socket.create_server(("127.0.0.1", 0)) as other:
        steps = load_driver("naoqi").probe(robot, f"//127.0.0.1:{other.getsockname()[1]}")
        assert [(step.subject, step.level) for step in steps] == [
            ("network", Level.OK), ("NAOqi", Level.FAULT),
        ]  # fmt: skip
