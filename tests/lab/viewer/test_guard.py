"""Faults 53 and 54: protection of the viewer's server from other programs and web sites."""

from __future__ import annotations

import http.client
import socket
import threading
from collections.abc import Iterator
from contextlib import closing

import pytest
import viser
import zstandard
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tci.errors import DriverError
from tci.lab.viewer.guard import Guard, open_server

PROTOCOL = f"viser-v{viser.__version__}"


class Opened:
    """A running server. Methods send requests to it."""

    def __init__(self, host: str) -> None:
        self.server, self.guard, self.address = open_server(host, 0, label="test", title="a <b> - TCI")
        self.port = int(self.address.split("?")[0].rstrip("/").rsplit(":", 1)[1])

    def get(self, path: str = "/", **headers: str) -> http.client.HTTPResponse:
        """Returns the response to a GET request with these headers. The default Host is the loopback
        address."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        connection.putrequest("GET", path, skip_host=True)
        for name, value in {"Host": f"127.0.0.1:{self.port}", **headers}.items():
            connection.putheader(name, value)
        connection.endheaders()
        return connection.getresponse()

    def socket_opens(self, *, origin: str | None, path: str = "/", **headers: str) -> bool:
        """Returns True if the server accepts a web socket from a page of `origin`."""
        try:
            with connect(
                f"ws://127.0.0.1:{self.port}{path}", origin=origin, subprotocols=[PROTOCOL],
                additional_headers=headers,
            ) as opened:  # fmt: skip
                return bool(opened.recv(timeout=30))
        except InvalidStatus as error:
            return error.response.status_code != 403


@pytest.fixture(scope="module")
def local() -> Iterator[Opened]:
    opened = Opened("127.0.0.1")
    yield opened
    opened.server.stop()


@pytest.fixture(scope="module")
def remote() -> Iterator[Opened]:
    opened = Opened("0.0.0.0")
    yield opened
    opened.server.stop()


def test_53_only_the_loopback_listens_by_default(local: Opened) -> None:
    assert local.get().status == 200
    assert "token" not in local.address
    with closing(socket.socket(socket.AF_INET, socket.SOCK_STREAM)) as elsewhere:
        # The server does not listen on any other address of this machine, not even on another loopback
        # address.
        assert elsewhere.connect_ex(("127.0.0.2", local.port)) != 0


def test_a_page_can_ask_whether_its_server_is_there(local: Opened) -> None:
    assert local.get("/alive").status == 204
    for packed in ({}, {"Accept-Encoding": "gzip"}):
        page = local.get(**packed)
        body = page.read()
        assert int(page.headers["Content-Length"]) == len(body)
        assert b"The viewer has ended" in body
        assert b"<title>a &lt;b&gt; - TCI</title>" in body
        assert body.count(b"<title>") == 1


def test_53_elsewhere_a_token_is_needed(remote: Opened) -> None:
    token = remote.address.split("token=")[1]
    assert len(token) >= 32
    here = f"http://127.0.0.1:{remote.port}"
    assert remote.get().status == 403
    assert remote.get("/?token=guess").status == 403
    assert not remote.socket_opens(origin=here)
    answer = remote.get(f"/?token={token}")
    assert answer.status == 200
    cookie = answer.getheader("Set-Cookie", "")
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    pair = cookie.split(";")[0]
    assert remote.get("/index.html", Cookie=pair).status == 200
    assert remote.socket_opens(origin=here, Cookie=pair)
    assert not remote.socket_opens(origin=here, Cookie=pair.split("=")[0] + "=guess")
    assert not remote.socket_opens(origin=here, path="/touch", Cookie=pair.split("=")[0] + "=guess")


def test_54_a_hostile_page_or_name_is_refused(local: Opened) -> None:
    mine = f"http://127.0.0.1:{local.port}"
    assert local.socket_opens(origin=mine)
    refused = local.guard.refused
    assert not local.socket_opens(origin="http://evil.example")
    assert not local.socket_opens(origin="null")
    assert not local.socket_opens(origin=None)
    assert not local.socket_opens(origin="http://evil.example", path="/touch")
    assert local.get(Host="evil.example").status == 403
    assert local.get(Host=f"evil.example:{local.port}").status == 403
    assert local.get(Host="").status == 403
    assert local.get(Host=f"localhost:{local.port}").status == 200
    assert local.get(Origin="http://evil.example").status == 403
    assert local.guard.refused == refused + 8


def test_54_a_rebound_name_is_refused_with_its_own_origin(remote: Opened) -> None:
    token = remote.address.split("token=")[1]
    path = f"/?token={token}"
    assert remote.get(path, Host="evil.example", Origin="http://evil.example").status == 403
    assert remote.get(path, Host="192.0.2.7:80").status == 200


def test_a_name_with_capitals_is_known_as_browsers_write_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(socket, "gethostname", lambda: "Lab-PC")
    opened = Opened("0.0.0.0")
    assert opened.address.startswith("http://Lab-PC:")
    assert opened.get(f"/?token={opened.guard.token}", Host=f"lab-pc:{opened.port}").status == 200
    opened.server.stop()


def test_the_page_can_not_be_framed(local: Opened) -> None:
    assert local.get().getheader("X-Frame-Options") == "DENY"


def test_the_page_is_told_what_is_set_while_its_sender_goes_to_sleep(
    local: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    event = local.server._websock_server._broadcast_buffer.message_event
    found_nothing, go_on = event._get_loop, threading.Event()

    def between_look_and_wait() -> object:
        if go_on.is_set():
            go_on.clear()
            other = threading.Thread(target=local.server.gui.add_markdown, args=("meanwhile",))
            other.start()
            other.join()
        return found_nothing()

    monkeypatch.setattr(event, "_get_loop", between_look_and_wait)
    origin = f"http://127.0.0.1:{local.port}"
    with connect(f"ws://127.0.0.1:{local.port}/", origin=origin, subprotocols=[PROTOCOL]) as page:
        go_on.set()
        local.server.gui.set_panel_label("wakes the sender")
        while "meanwhile" not in told(page.recv(timeout=40)):
            pass


def told(window: str | bytes) -> str:
    """Returns the texts in the messages of viser. A message consists of two lengths, messages and arrays."""
    assert isinstance(window, bytes)
    length, packed = (int.from_bytes(window[start : start + 8], "little") for start in (0, 8))
    return zstandard.decompress(window[16 : 16 + packed], max_output_size=length).decode(errors="replace")


def test_36_a_port_that_is_taken_is_named(local: Opened) -> None:
    with pytest.raises(DriverError, match=rf"port {local.port} of 127.0.0.1: .*in use; valid: a free port"):
        open_server("127.0.0.1", local.port, label="test")


@pytest.mark.parametrize("host", ["", "[", "::", "a b", "127.0.0.1.evil.example", "localhost.evil.example"])
def test_hosts_that_are_none(host: str) -> None:
    assert not Guard("127.0.0.1", "")._is_here(host)
