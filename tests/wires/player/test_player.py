"""Player: TCI's driver and server against recorded messages of genuine Player 3.1.1 as server and as
client."""

from __future__ import annotations

import contextlib
import os
import random
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tci
from helpers.felt_skin import FeltSkin
from helpers.player_exchange import RecordedServer, gist, read, said
from helpers.rosbridge_exchange import narrow
from tci.drivers.simulated import SimulatedDriver
from tci.errors import DriverError, FrameError
from tci.gate.safe_command import GateState
from tci.messages import JointReading, Reading, SkinFrame
from tci.robot.joint_map import initial_position
from tci.runtime.serve import serve
from tci.wires.player import wire
from tci.wires.player.client import parse
from tci.wires.player.driver import FRAMES, STATES
from tci.wires.player.server import MOST_OWED, PlayerServer
from tci.wires.player.wire import ACTARRAY, OPAQUE, Message, MessageKind, Stream
from yarpwire.outgoing import is_readable

DECODERS = (wire.to_floats, wire.to_blob, wire.to_actuators, wire.to_devices, wire.to_access)
FUZZ = int(os.environ.get("TCI_FUZZ_WIRE", "20000"))


@pytest.fixture
def server() -> Iterator[RecordedServer]:
    one = RecordedServer()
    yield one
    one.close()


def test_the_client_says_what_the_genuine_server_understood(server: RecordedServer) -> None:
    with tci.connect(narrow(), f"player:127.0.0.1:{server.port}", arm=True) as driver:
        first = driver.read()
        assert {frame.patch: frame.values.shape for frame in first.skin} == {
            "left_forearm": (240,), "right_forearm": (240,),
        }  # fmt: skip
        still = [
            servo.index for servo in driver.robot.servos if servo.joint is not None
        ]  # not the hand, which was shut
        expected = initial_position(driver.robot)[still]
        np.testing.assert_allclose(first.joints.position[still], expected, atol=1e-3)
        pending = [driver.native("LArm").command({"LElbowRoll": -1.1})]
        for now in driver.ticks(duration=0.5):
            driver.write(driver.gate.step(pending, driver.read().joints, now))
            pending = []
        assert driver.read().joints.sequence > first.joints.sequence + 10
    recorded = {gist(read(data)) for _, who, data in said("client") if who == "client"}
    assert {gist(message) for message in server.heard} == recorded


def test_28_a_server_that_dies_means_hold(server: RecordedServer) -> None:
    with tci.connect(narrow(), f"player:127.0.0.1:{server.port}", arm=True) as driver:
        server.close()
        for now in driver.ticks(duration=10.0):
            held = driver.write(driver.gate.step([], driver.read().joints, now))
            if held.state is GateState.HOLD:
                break
        assert held.state is GateState.HOLD
    with pytest.raises(DriverError, match="closed"):
        driver.read()


def test_31_35_what_does_not_fit_is_counted_or_ends_the_connection(server: RecordedServer) -> None:
    with tci.connect(narrow(), f"player:127.0.0.1:{server.port}") as driver:
        now = 1e9
        for interface, index, body in (
            (ACTARRAY, 1, wire.actuators(np.zeros(3), np.zeros(3))),
            (ACTARRAY, 1, struct.pack(">II", 2**31 - 1, 2**31 - 1)),
            (ACTARRAY, 1, struct.pack(">II", 2**32 - 1, 2**32 - 1)),
            (OPAQUE, 0, wire.blob(b"abc")),
            (OPAQUE, 0, b""),
        ):
            now += 1.0
            before = driver.rejected
            damaged = Message(interface, index, MessageKind.DATA, 1, now, body).to_bytes()

            def disturb(damaged: bytes = damaged) -> None:  # only the latest message of a device is used
                server.send(damaged)
                driver.read()

            wait(disturb, lambda before=before: driver.rejected > before)
        assert np.isfinite(driver.read().joints.position).all()
        for size in (2**31 - 1, 2**32 - 1, wire.MOST + 1):
            with pytest.raises(FrameError, match="declared"):
                list(Stream().feed(wire.HEADER.pack(0, 0, ACTARRAY, 0, 1, 1, 0.0, 0, size)))


def wait(do: Callable[[], object], done: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not done():
        assert time.monotonic() < end
        do()
        time.sleep(0.005)


def play(port: int) -> list[tuple[int, Message]]:
    """Sends the recorded messages of the genuine client on each of its connections, and returns the answers
    of TCI's server."""
    found = []
    recorded = [(who, data) for _, who, data in said("server")]
    connections = sum(data.startswith(b"Player v.") for _, data in recorded)
    for number, (_, data) in enumerate(recorded):
        if data.startswith(b"Player v.") or read(data).kind != MessageKind.REQUEST:
            continue
        with socket.create_connection(("127.0.0.1", port), timeout=10.0) as connection:
            assert connection.recv(32).startswith(b"Player v.3")
            connection.sendall(data)
            stream = Stream()
            while not (got := [m for m in stream.feed(connection.recv(4096)) if m.kind != MessageKind.DATA]):
                pass
            found.append((number, got[0]))
    assert connections >= 2
    return found


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("bits", ["7fc00000", "7fa00001"], ids=["quiet", "signalling"])
def test_what_is_not_a_number_is_read_as_such(bits: str) -> None:
    """The skin processing refuses a NaN. In an earlier version a signalling NaN caused a warning of NumPy."""
    value = bytes.fromhex(bits)
    assert np.isnan(wire.to_floats(wire.array(value, 1))).all()
    robot = tci.load_robot("nao")
    patch = robot.patches[0]
    frame = SkinFrame(patch.name, 1.0, 0, wire.to_skin(value * patch.channels, patch.channels))
    reading = Reading(JointReading(1.0, 0, initial_position(robot), 0.0 * initial_position(robot)), (frame,))
    assert not FeltSkin(robot).update(reading)[patch.name].pressure.any()


def test_the_server_answers_as_the_genuine_client_understood_and_obeys_it() -> None:
    with SimulatedDriver(tci.load_robot("nao")) as driver, PlayerServer(driver, "127.0.0.1:0") as server:
        answers: list[tuple[int, Message]] = []
        thread = threading.Thread(target=lambda: answers.extend(play(server.port)), daemon=True)
        thread.start()
        wait(lambda: serve(server, duration=0.02, clock=driver.clock), lambda: not thread.is_alive())
        recorded = [read(data) for _, who, data in said("server") if not data.startswith(b"Player v.")]
        expected = [m.body for m in recorded if m.kind == MessageKind.ACK and m.subtype == wire.SUBSCRIBE]
        got = [m.body for _, m in answers]
        assert {wire.to_access(body) for body in expected} <= {wire.to_access(body) for body in got}
        assert {len(body) for body in got} == {len(body) for body in expected}
        commands = [m for m in recorded if m.kind == MessageKind.COMMAND]
        assert len(commands) > 10
        with socket.create_connection(("127.0.0.1", server.port)) as connection:
            rest = iter(commands)

            def send(tick: object) -> None:
                if (message := next(rest, None)) is not None:
                    connection.sendall(message.to_bytes())

            serve(server, duration=2.0, observe=send, clock=driver.clock)
        wanted = wire.to_floats(commands[-1].body)
        for servo, angle in zip(driver.robot.servos_of("LArm"), wanted, strict=True):
            if servo.limits.jerk is not None:
                assert driver.read().joints.position[servo.index] == pytest.approx(angle, abs=0.01)


def test_36_a_taken_port_and_others_are_told() -> None:
    robot = tci.load_robot("nao")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with SimulatedDriver(robot) as driver, pytest.raises(DriverError, match="valid: a free port"):
            PlayerServer(driver, f"127.0.0.1:{port}")
    with pytest.raises(DriverError, match=f"no Player server at 127.0.0.1:{port}"):
        tci.connect(robot, f"player:127.0.0.1:{port}")
    assert parse("") == ("127.0.0.1", 6665)
    for address in ("a b", "host:99999", "host/x"):
        with pytest.raises(DriverError, match="valid: player:HOST:PORT"):
            parse(address)


@pytest.mark.parametrize(
    ("request_", "times"),
    [
        (Message(OPAQUE, STATES, MessageKind.REQUEST, wire.FACTS, 0.0, b""), 1000),
        (Message(wire.PLAYER, 0, MessageKind.REQUEST, wire.DEVLIST, 0.0, b""), 12_000),
        (Message(wire.PLAYER, 0, MessageKind.REQUEST, 99, 0.0, b""), 40_000),
    ],
    ids=["facts", "devices", "nonsense"],
)
def test_33_a_client_that_asks_and_does_not_read_is_let_go_and_little_waits_for_it(
    request_: Message, times: int
) -> None:
    robot = tci.load_robot("nao")
    with (
        SimulatedDriver(robot) as driver,
        PlayerServer(driver, "127.0.0.1:0") as server,
        socket.create_connection(("127.0.0.1", server.port), timeout=30.0) as quiet,
        socket.socket() as greedy,
    ):
        wait(server.fault, lambda: len(server._clients) == 1)
        greedy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 12)
        greedy.settimeout(30.0)
        greedy.connect(("127.0.0.1", server.port))
        wait(server.fault, lambda: len(server._clients) == 2)
        client = server._clients[1]
        client.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 12)
        most = 0

        def look() -> None:
            nonlocal most
            server.fault()
            most = max(most, len(client.out))

        flood = threading.Thread(target=ask, args=(greedy, request_.to_bytes() * times), daemon=True)
        flood.start()
        wait(look, lambda: client not in server._clients)
        flood.join()
        assert most < 2 * MOST_OWED
        assert "does not read" in server.last_error
        assert len(server._clients) == 1
        quiet.sendall(request_.to_bytes())
        wait(server.fault, lambda: is_readable(quiet, 0.0))


def ask(connection: socket.socket, data: bytes) -> None:
    with contextlib.suppress(ConnectionError):
        connection.sendall(data)


def test_geometry_and_lists_have_the_lengths_of_players_own_structs() -> None:
    assert len(wire.geometry([(-1.0, 1.0, 0.0, 2.0)] * 3)) == 8 + 3 * 80 + 48
    assert len(wire.actuators(np.zeros(3), np.zeros(3))) == 8 + 3 * 20 + 4
    listed = [(ACTARRAY, 0), (OPAQUE, 7), (OPAQUE, STATES), (OPAQUE, FRAMES)]
    assert wire.to_devices(wire.devices(listed, 6665)) == listed


@given(
    st.sampled_from(["<u1", "<u2", "<f4", "<f8", "<i2", "<i4"]), st.integers(1, 40), st.integers(0, 2**32 - 1)
)
def test_skin_of_every_type_comes_back(dtype: str, channels: int, seed: int) -> None:
    values = np.random.default_rng(seed).integers(0, 200, channels).astype(dtype)
    np.testing.assert_array_equal(wire.to_skin(wire.to_blob(wire.blob(wire.skin(values))), channels), values)


def test_31_mutated_bytes_are_messages_or_refused() -> None:
    """Arbitrary bytes use no more memory than was received and raise no other error, and the server
    continues."""
    good = [data for _, _, data in said("client") + said("server") if not data.startswith(b"Player v.")]
    chance = random.Random(5)
    robot = narrow()
    for _ in range(FUZZ):
        raw = bytearray(chance.choice(good))
        for _ in range(chance.randint(1, 4)):
            raw[chance.randrange(len(raw))] = chance.randrange(256)
        if chance.random() < 0.25:
            del raw[chance.randrange(len(raw) + 1) :]
        try:
            for message in Stream().feed(bytes(raw)):
                assert len(message.body) <= len(raw)
                for decode in DECODERS:
                    try:
                        decode(message.body)
                    except FrameError:
                        continue
        except FrameError:
            continue
    with SimulatedDriver(robot) as driver, PlayerServer(driver, "127.0.0.1:0") as server:
        for _ in range(200):
            raw = bytearray(chance.choice(good))
            raw[chance.randrange(len(raw))] = chance.randrange(256)
            with socket.create_connection(("127.0.0.1", server.port)) as stranger:
                stranger.sendall(bytes(raw))
            list(server._poll())
        with socket.create_connection(("127.0.0.1", server.port), timeout=10.0) as connection:
            connection.sendall(
                Message(wire.PLAYER, 0, MessageKind.REQUEST, wire.DEVLIST, 0.0, b"").to_bytes()
            )
            wait(lambda: list(server._poll()), lambda: len(server._clients) > 0)
            list(server._poll())
            assert connection.recv(32).startswith(b"Player v.3")
            (answer,) = Stream().feed(connection.recv(4096))
            assert (OPAQUE, STATES) in wire.to_devices(answer.body)
