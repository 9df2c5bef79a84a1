"""Name server and its client: tested with recorded sessions of genuine ports, and with each other."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from helpers.yarp_captures import NAMES, naming
from yarpwire import names as yarp_names
from yarpwire.connection_limit import AcceptedConnection
from yarpwire.errors import PortError, UnknownNameError, WireError
from yarpwire.listener import Listener
from yarpwire.name_server import NameServer
from yarpwire.names import Contact, Names, find_server, parse_contact, read_key


@pytest.fixture
def server() -> Iterator[NameServer]:
    with NameServer() as running:
        yield running


@pytest.mark.parametrize("name", NAMES)
def test_real_ports_hear_from_our_name_server_what_they_heard_from_the_real_one(
    name: str, server: NameServer
) -> None:
    """Registrations that existed before the recording are made first."""
    answered = 0
    for connection in naming(name):
        request, real = connection[0][1].decode(), connection[1][1].decode()
        verb, port = request.split()[1:3]
        if (found := re.search(r"ip (\S+) port (\d+)", real)) and verb in ("register", "query"):
            server.answer(f"NAME_SERVER register {port} tcp {found[1]} {found[2]}\n")
            if verb == "register":
                continue
        assert server.answer(request) == real, request
        answered += 1
    assert answered >= 2


def test_register_query_list_unregister(server: NameServer) -> None:
    names = Names(server.address)
    names.register(Contact("/tci/a", "127.0.0.1", 4321), {"offers": "tcp udp"})
    assert names.query("/tci/a") == Contact("/tci/a", "127.0.0.1", 4321)
    assert [contact.name for contact in names.list()] == ["/root", "/tci/a"]
    assert names.request("check", "/tci/a", "offers", "udp") == [
        "port /tci/a property offers value udp present true"
    ]
    names.unregister("/tci/a")
    with pytest.raises(UnknownNameError, match="/root"):
        names.query("/tci/a")


def test_the_name_server_is_a_port_too(server: NameServer) -> None:
    """What `yarp exists /root` and `yarp check` of YARP 3.12 send, and what they read."""
    with socket.create_connection(server.address, timeout=5.0) as sock, sock.makefile("rw") as stream:
        stream.write("CONNACK admin\r\na\r\n[ver]\r\n")
        stream.flush()
        assert stream.readline().startswith("Welcome admin")
        assert [stream.readline().strip() for _ in range(2)] == ["[ver] 1 2 3", "<ACK>"]
    assert [contact.name for contact in Names(server.address).list()] == ["/root"]


def test_numbers_are_given_out_for_three_dots_and_minus_one(server: NameServer) -> None:
    numbers = set()
    for line in ("register /a", "register /b ... ... ...", "register /c ... ... -1 yarp/vector"):
        contact = parse_contact(server.answer(f"NAME_SERVER {line}\n"))
        assert contact is not None
        numbers.add(contact.port)
    assert len(numbers) == 3
    assert min(numbers) > server.address[1]
    again = parse_contact(server.answer("NAME_SERVER register /a\n"))
    assert again is not None
    assert again.port in numbers


def test_a_connection_may_be_used_again_and_nonsense_ends_it(server: NameServer) -> None:
    with socket.create_connection(server.address, timeout=2) as sock:
        for _ in range(3):
            sock.sendall(b"NAME_SERVER query /nobody\n")
            assert sock.recv(100) == b"*** end of message\r\n"
        sock.sendall(b"GET / HTTP/1.1\r\n")
        assert sock.recv(100) == b""
    assert Names(server.address).list()


def test_36_a_taken_port_is_a_clear_error(server: NameServer) -> None:
    with pytest.raises(PortError, match=rf"{server.address[1]}.*valid: a free port"):
        NameServer(*server.address)


def test_who_knows_the_key_is_answered_and_nobody_else() -> None:
    with NameServer(key=b"secret") as server:
        assert Names(server.address, key=b"secret").list()
        with pytest.raises(PortError, match=r"auth\.conf"):
            Names(server.address, key=b"wrong").list()
        with pytest.raises(PortError, match="does not answer"):
            Names(server.address).request("query", "/root")


@pytest.mark.parametrize(
    "said", [b"", b"no", b"n\xffnce\nand mac", b"registration name /a ip 1.2.3.4 port 1 type tcp\r\n"]
)
def test_an_answer_without_its_end_is_none(said: bytes) -> None:
    """A nonce of eight bytes and its MAC sometimes contain a line feed."""

    def hang_up(sock: socket.socket, connection: AcceptedConnection) -> None:
        sock.recv(100)
        sock.sendall(said)

    listener = Listener("127.0.0.1", 0, hang_up, name="a server")
    with pytest.raises(PortError, match="closed the connection"):
        Names(listener.address).query("/a")
    listener.close()


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("YARP_CONFIG_HOME", str(tmp_path))
    monkeypatch.delenv("YARP_NAMESPACE", raising=False)
    return tmp_path


def test_the_name_server_is_found_in_its_file(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (home / "yarp.conf").write_text("10.0.0.2 10123 yarp\n")
    assert find_server() == ("10.0.0.2", 10123)
    monkeypatch.setenv("YARP_NAMESPACE", "/my-robot")
    (home / "_my_robot.conf").write_text("10.0.0.3 10000 yarp\n")
    assert find_server() == ("10.0.0.3", 10000)
    (home / "_my_robot.conf").write_text("nothing\n")
    with pytest.raises(PortError, match="HOST PORT"):
        find_server()


def test_without_a_file_and_an_answer_the_error_says_what_to_do(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(yarp_names, "detect", lambda space: None)
    with pytest.raises(PortError, match=r"an address HOST:PORT.*yarpserver"):
        find_server()


def test_the_key_is_read_from_its_file(home: Path) -> None:
    assert read_key() is None
    (home / "auth.conf").write_text('[AUTH]\nkey "an other secret"\n')
    assert read_key() == b"an other secret"
    (home / "auth.conf").write_text("key nothing\n")
    with pytest.raises(PortError, match=r"\[AUTH\]"):
        read_key()


def test_a_client_can_not_fill_the_name_servers_memory() -> None:
    with NameServer() as server:
        server.answer("NAME_SERVER register /a")
        for number in range(16):
            server.answer(f"NAME_SERVER set /a key{number} value")
        assert server.answer("NAME_SERVER set /a key0 other").startswith("port /a property key0 = other")
        with pytest.raises(WireError, match="more than 16 properties of /a"):
            server.answer("NAME_SERVER set /a key16 value")
        with pytest.raises(WireError, match="a request of 3022 characters; valid: at most 2000"):
            server.answer(f"NAME_SERVER register /{'a' * 3000}")
