"""Ports and calls of YARP's own bindings against yarpwire's, in the bindings' dialect.

Neither Debian nor PyPI has the bindings, so these tests run only where the bindings are installed. There the
contract suite, `drivers/test_driver.py`, also tests the driver with the bindings.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from helpers.patient import patient
from helpers.peers import needs_yarp_bindings
from helpers.wire_peers import bindings_configured
from helpers.yarp_show import Show, until
from tci.errors import DriverError
from tci.gate.gate import GateState
from tci.wires.yarp.address import parse
from tci.wires.yarp.driver import YarpDriver
from yarpwire.bindings.network import Bindings
from yarpwire.board import find_board
from yarpwire.dialect import DIALECTS, Dialect
from yarpwire.errors import PortError, UnknownNameError
from yarpwire.incoming import Delivery
from yarpwire.message import Stamp
from yarpwire.name_server import NameServer
from yarpwire.names import PATIENCE, parse_address
from yarpwire.network import Network
from yarpwire.values import Vocab
from yarpwire.wire import Wire

SPOKEN = DIALECTS[needs_yarp_bindings()]
ITEMS = [Vocab("set"), 1, -2.5e-7, "two words, \u00e9", [3, 4.5, [Vocab("ok")]], 1 << 40]


@pytest.fixture
def dialect() -> Iterator[Dialect]:
    """Yields the dialect of the bindings, while a name server of yarpwire is running."""
    with bindings_configured() as where, NameServer(*parse_address(where)):
        yield SPOKEN


@pytest.fixture(params=["bindings to bindings", "bindings to ours", "ours to bindings"])
def ends(request: pytest.FixtureRequest, dialect: Dialect) -> tuple[Network, Network]:
    """Returns the networks of the sender and of the receiver."""
    networks = {"bindings": Bindings(), "ours": Wire()}
    sender, receiver = request.param.split(" to ")
    return networks[sender], networks[receiver]


@pytest.mark.parametrize("carrier", ["tcp", "fast_tcp", "udp"])
def test_messages_arrive_as_they_were_sent(
    ends: tuple[Network, Network], dialect: Dialect, carrier: str
) -> None:
    sender, receiver = ends
    got: list[Delivery] = []
    writer = sender.port("/out", dialect)
    listener = receiver.port("/in", dialect, got.append)
    try:
        listener.listen_to("/out", carrier)
        assert until(lambda: bool(writer.outputs))
        numbers = np.array([0.1, -1e300, np.pi, 5e-324, 255.0] * 200)
        for value, stamp in ((numbers, Stamp(7, 1795218732.25)), (ITEMS, Stamp(8, 0.5))):
            for _ in range(20):  # udp may lose some
                writer.write(value, stamp)
                if until(lambda stamp=stamp: any(one.stamp == stamp for one in got), within=2.0):
                    break
    finally:
        listener.close()
        writer.close()
    assert {one.sender for one in got} == {"/out"}
    found = {one.stamp.count: one for one in got if one.stamp is not None}
    assert found[7].vector(dialect).tolist() == numbers.tolist()
    assert found[8].items(dialect) == ITEMS


def test_calls_are_answered(ends: tuple[Network, Network], dialect: Dialect) -> None:
    asks, answers = ends
    port = answers.port("/answers", dialect, lambda delivery: [Vocab("is"), *delivery.items(dialect)])
    caller = asks.caller(asks.query("/answers"), "/asks", dialect)
    try:
        assert caller.call(*ITEMS) == [Vocab("is"), *ITEMS]
        caller.send_call(1)
        caller.send_call(2.5)
        assert caller.is_answered(20.0)
        assert caller.read_reply() == [Vocab("is"), 1]
        assert caller.is_answered(20.0)
        assert caller.read_reply() == [Vocab("is"), 2.5]
    finally:
        caller.close()
        port.close()
    with pytest.raises(PortError):
        caller.call(1)


def test_a_call_that_nobody_answers_is_an_error_and_the_next_one_is_made_anew(dialect: Dialect) -> None:
    network, stuck = Bindings(), threading.Event()

    def answer(delivery: Delivery) -> list[Any]:
        if delivery.items(dialect) == [1]:
            stuck.wait(60.0)
        return [0]

    port = Wire().port("/slow", dialect, answer)
    caller = network.caller(network.query("/slow"), "/asks", dialect)
    try:
        with pytest.raises(PortError, match="/slow does not answer"):
            caller.call(1, patience=0.2)
        assert caller.call(2) == [0]
    finally:
        stuck.set()
        caller.close()
        port.close()


def test_messages_of_one_period_arrive(dialect: Dialect) -> None:
    got: list[Any] = []
    port = Wire().port("/reads", dialect, lambda delivery: got.extend(delivery.items(dialect)))
    writer = Bindings().writer("/reads", "/writes")
    try:
        taken = 0
        for period in range(100):
            taken += sum(writer.offer([period], dialect) for _ in range(3))
            time.sleep(0.002)
        assert until(lambda: len(got) == taken)
        assert taken > 200  # a busy machine may drop some messages, but not two of three
    finally:
        writer.close()
        port.close()


def test_a_writer_tells_that_its_reader_is_gone(dialect: Dialect) -> None:
    network = Bindings()
    reading = Wire().port("/reads", dialect, lambda delivery: None)
    writer = network.writer("/reads", "/writes")
    assert not writer.is_over()
    reading.close()

    def lost() -> bool:
        try:
            return not writer.offer([1], dialect) and writer.is_over()
        except PortError:
            return True

    assert until(lost)
    writer.close()
    with pytest.raises(UnknownNameError, match="'/reads'"):
        network.writer("/reads", "/writes")


def test_a_connection_that_rests_stays_open(dialect: Dialect) -> None:
    port = Bindings().port("/rests", dialect, lambda delivery: None)
    writer = Wire().writer("/rests", "/writes")
    try:
        time.sleep(PATIENCE + 0.5)
        assert not writer.is_over()
    finally:
        writer.close()
        port.close()


def test_their_name_server_and_their_dialect_are_the_only_ones(dialect: Dialect) -> None:
    other = next(name for name in DIALECTS if name != dialect.name)
    with pytest.raises(DriverError, match="support no other"):
        parse(f"bindings,dialect={other}").network()
    with pytest.raises(DriverError, match=r"valid: yarp conf 127\.0\.0\.1 9 before"):
        parse("127.0.0.1:9,bindings").network()
    assert Bindings().address == Wire().address


def test_a_robot_that_they_serve_is_found_and_moved_by_ours(dialect: Dialect) -> None:
    show = Show(dialect, where="bindings")
    try:
        board = find_board(Wire(), "/nao/LArm", "/asks")
        assert (board.dialect, board.axes(), board.name(3)) == (dialect, 6, "LElbowRoll")
        board.close()
        with YarpDriver(patient("nao")) as driver:
            assert set(driver.boards) == {"Head", "LArm", "RArm"}
            assert {frame.patch for frame in driver.read().skin} == {
                patch.name for patch in driver.robot.patches
            }
        with YarpDriver(patient("nao"), show.server.reach().removeprefix("yarp:"), arm=True) as driver:
            assert driver.network.title == show.network.title
            arm = driver.native("LArm")

            def arrived() -> bool:
                orders = [arm.command({"LElbowRoll": -1.2})]
                for now in driver.ticks(duration=0.5):
                    driver.write(driver.gate.step(orders, driver.read().joints, now))
                    orders = []
                if driver.gate.state is GateState.STOP:
                    driver.gate.reset()
                return abs(arm.positions(driver.read().joints)["LElbowRoll"] + 1.2) < 0.01

            assert until(arrived)
    finally:
        show.close()
