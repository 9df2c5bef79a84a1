"""Features that only Zenoh has: addresses, the run-time query, and errors with advice."""

from __future__ import annotations

import hmac
import time
from contextlib import ExitStack

import numpy as np
import pytest
import zenoh

import tci
from helpers.wire_peers import free_port
from tci.drivers.registry import open_server
from tci.drivers.remote.encoding import orders_bytes
from tci.drivers.remote.protocol import Orders
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError
from tci.exports.facts import query, read_facts
from tci.gate.contact.settings import ContactSettings
from tci.messages import JointReading, Mode, PlatformCommand
from tci.wires.zenoh.driver import ZenohDriver, ZenohServer
from tci.wires.zenoh.session import close_session, open_session, parse_address


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("", "zenoh:nao@tcp/127.0.0.1:7447"),
        ("kitchen@", "zenoh:kitchen@tcp/127.0.0.1:7447"),
        ("tls/robot.local:7447", "zenoh:nao@tls/robot.local:7447"),
        ("kitchen@/etc/tci/robot.json5", "zenoh:kitchen@/etc/tci/robot.json5"),
    ],
)
def test_addresses(text: str, shown: str) -> None:
    assert str(parse_address(text, "nao")) == shown


@pytest.mark.parametrize("text", ["10.0.0.5:7447", "a b@tcp/h:1", "tci/nao@tcp/h:1", "tcp", "x@tcp/"])
def test_wrong_addresses_say_what_is_valid(text: str) -> None:
    with pytest.raises(DriverError, match="valid"):
        parse_address(text, "nao")


def test_36_a_port_that_is_taken_is_told() -> None:
    where = parse_address(f"tcp/127.0.0.1:{free_port()}", "nao")
    session = open_session(where, "listen")
    try:
        with (
            SimulatedDriver(tci.load_robot("nao")) as driver,
            pytest.raises(DriverError, match=r"in use.*valid: a port that no other program uses"),
        ):
            open_server(driver, str(where))
    finally:
        close_session(session)


def test_nobody_there_and_a_missing_file_are_told() -> None:
    with pytest.raises(DriverError, match="connect"):
        tci.connect(tci.load_robot("nao"), f"zenoh:tcp/127.0.0.1:{free_port()}")
    with pytest.raises(DriverError, match="json5"):
        tci.connect(tci.load_robot("nao"), "zenoh:/no/such/file.json5")


def test_the_names_of_robots_there_are_told_and_the_run_time_query_answers() -> None:
    robot = tci.load_robot("nao")
    port = free_port()
    with (
        SimulatedDriver(robot) as driver,
        open_server(driver, f"zenoh:kitchen@tcp/127.0.0.1:{port}") as server,
    ):
        assert isinstance(server, ZenohServer)
        with pytest.raises(DriverError, match="robots served there: kitchen"):
            ZenohDriver(robot, f"hall@tcp/127.0.0.1:{port}")
        session = open_session(parse_address(f"kitchen@tcp/127.0.0.1:{port}", "nao"), "connect")
        found = [list(session.get(f"tci/{name}/facts", timeout=5.0)) for name in ("kitchen", "*")]
        close_session(session)
    for replies in found:
        assert [reply.ok is not None for reply in replies] == [True]
        assert replies[0].ok is not None
        assert str(replies[0].ok.key_expr) == "tci/kitchen/facts"
        assert read_facts(replies[0].ok.payload.to_bytes()) == query(robot)


def test_doctor_tells_step_by_step_what_is_there() -> None:
    robot, where = tci.load_robot("nao"), f"tcp/127.0.0.1:{free_port()}"

    def told(address: str) -> list[tuple[str, str]]:
        return [(finding.subject, finding.level.value) for finding in ZenohDriver.probe(robot, address)]

    assert told(where) == [("session", "fault")]
    with SimulatedDriver(robot) as driver, ZenohServer(driver, where):
        assert told(where) == [("session", "ok"), ("robot", "ok"), ("description", "ok")]
        assert told(f"other@{where}") == [("session", "ok"), ("robot", "fault")]
        assert "robots served there: nao" in ZenohDriver.probe(robot, f"other@{where}")[1].what
        other = robot.model_copy(update={"digest": "0123456789abcdef" * 4})
        assert "different" in ZenohDriver.probe(other, where)[2].what
    assert told("no endpoint") == [("session", "fault")]


def test_a_stranger_who_reads_a_commander_s_number_commands_nothing() -> None:
    """Everybody sees the numbers of commanders, in each state; with a copied one a stranger moved joints that
    somebody else commanded."""
    robot, where = tci.load_robot("nao"), f"tcp/127.0.0.1:{free_port()}"
    turn = PlatformCommand(Mode.POSITION, np.arange(1), np.array([0.4]), np.array([np.inf]))
    with ExitStack() as closing, SimulatedDriver(robot) as driver, ZenohServer(driver, where) as server:
        commander, stranger = (open_session(parse_address(where, "nao"), "connect") for _ in range(2))
        for session in (commander, stranger):
            closing.callback(close_session, session)

        def join(session: zenoh.Session) -> list[bytes]:
            replies = session.get("tci/nao/join?client=7", timeout=5.0)
            return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]

        def send(session: zenoh.Session, number: int, secret: bytes | None) -> int:
            """Sends an order of commander 7; returns how many orders reach the gate."""
            message = Orders(
                server.number, time.monotonic(), 7, "somebody", number, None, False, number, (turn,)
            )
            data = orders_bytes(robot, message)
            signature = None if secret is None else hmac.digest(secret, data, "sha256")
            before, taken = server.rejected, 0
            session.put("tci/nao/orders/7", data, attachment=signature)
            while not taken and server.rejected == before:
                server.fault()
                taken += len(server.orders())
            return taken

        (secret,) = join(commander)
        assert send(commander, 1, secret) == 1
        assert join(stranger) == [], "a secret is given once"
        assert send(stranger, 2, None) == 0
        assert send(stranger, 3, bytes(32)) == 0
        assert send(commander, 4, secret) == 1


def test_an_operator_frees_over_the_wire_what_a_part_that_stops_holds() -> None:
    robot, where = tci.load_robot("nao"), f"tcp/127.0.0.1:{free_port()}"
    with ExitStack() as closing, SimulatedDriver(robot) as driver, ZenohServer(driver, where):
        session = open_session(parse_address(where, "nao"), "connect")
        closing.callback(close_session, session)
        gate, period = driver.gate, driver.period
        gate.set_contact(ContactSettings(answers={"head": "stop"}))
        start = np.array(driver.read().joints.position)
        angles = start.copy()

        def step(number: int, *orders: PlatformCommand) -> float:
            """A head that somebody holds at 6 degrees."""
            now = number * period
            safe = gate.step(orders, JointReading(now, number, angles.copy(), np.zeros(len(angles))), now)
            angles[safe.servos] = safe.position
            angles[0] = min(angles[0], start[0] + 0.1)
            return float(safe.position[safe.servos.tolist().index(0)])

        def asked() -> str:
            (reply,) = session.get("tci/nao/free", timeout=5.0)
            said = reply.ok or reply.err
            assert said is not None
            return said.payload.to_string()

        assert "nothing is in contact" in asked()
        turn = PlatformCommand(Mode.POSITION, np.arange(1), start[:1] + 0.6, np.array([np.inf]))
        step(0, turn)
        held = [step(number) for number in range(1, 400)]
        assert held[-1] > start[0] + 0.1, "it stays stiff where it stopped"
        assert asked() == "moves away"
        freed = [step(number) for number in range(400, 2500)]
        assert freed[-1] < start[0] + 0.08
