"""Access control of the web server. The server accepts requests only from its own page. Requests from other
machines also need a token.

A page of another web site in the user's browser could send requests to a server on the loopback interface,
directly or through DNS rebinding. Therefore every request must name this machine as its host, and every web
socket must come from a page of this host.
"""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import os
import re
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from contextlib import redirect_stdout
from html import escape
from http import HTTPStatus
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request, Response

from tci.errors import DriverError, TciError
from yarpwire.connection_limit import PATIENCE, ConnectionLimit

LOOPBACK = ("127.0.0.1", "::1", "localhost")
TOUCH = "/touch"
"""Path of the web socket on which a page tells where its fingers are. It has the guard of all requests."""
ALIVE = "/alive"
"""Path that the page requests to check if the server is still running."""
SCRIPT = Path(__file__).with_name("page.js").read_text(encoding="utf-8")
_patching = threading.Lock()

Answer = Callable[[Any, Request], Response | None]
Touched = Callable[[ServerConnection], Awaitable[None]]


class Guard:
    """Checks each request before the server handles it."""

    def __init__(self, host: str, token: str, *, title: str = "TCI") -> None:
        """Creates the access control. The server listens on the address `host`, and the page has the title
        `title`. Every client needs the `token`, except if `token` is empty."""
        self.local = host in LOOPBACK
        self.token = token
        self.title = title
        self.refused = 0
        """Number of refused requests."""
        names = () if self.local else (host, socket.gethostname())
        self._names = {"localhost", *(name.lower() for name in names)}
        self._cookie = f"tci_{secrets.token_hex(4)}"

    def wrap(self, answer: Answer) -> Answer:
        """Returns a function that calls `answer` for permitted requests only."""

        def judge(connection: Any, request: Request) -> Response | None:
            reason = self.refusal(request)
            connection.counted.verified = not reason
            if reason:
                self.refused += 1
                body = f"{reason}\n".encode()
                headers = Headers({"Content-Type": "text/plain", "Content-Length": str(len(body))})
                return Response(HTTPStatus.FORBIDDEN, "Forbidden", headers, body)
            if urlsplit(request.path).path == ALIVE:
                return Response(HTTPStatus.NO_CONTENT, "No Content", Headers())
            if "Accept-Encoding" in request.headers:
                # The page must not be compressed, because a script is added to it.
                del request.headers["Accept-Encoding"]
            response = answer(connection, request)
            if response is not None:
                _adapt_page(response, self.title)
                response.headers["X-Frame-Options"] = "DENY"
                response.headers["Referrer-Policy"] = "no-referrer"
                if self.token and _query_token(request):
                    cookie = f"{self._cookie}={self.token}; HttpOnly; SameSite=Strict; Path=/"
                    response.headers["Set-Cookie"] = cookie
            return response

        return judge

    def refusal(self, request: Request) -> str:
        """Returns the reason to refuse a request, or an empty text if the request is permitted."""
        try:
            host, origin = request.headers.get("Host"), request.headers.get("Origin")
            socket_wanted = (request.headers.get("Upgrade") or "").lower() == "websocket"
            cookies = request.headers.get("Cookie") or ""
        except MultipleValuesError:
            return "a header occurs twice"
        if host is None or not self._is_here(host):
            return "this host name is not the viewer's"
        if (origin is not None or socket_wanted) and origin not in (f"http://{host}", f"https://{host}"):
            return "this page is not the viewer's"
        if self.token and not self._knows_token(_query_token(request), cookies):
            return "a token is needed: open the whole address that tci view printed"
        return ""

    def _is_here(self, host: str) -> bool:
        """Returns True if `host`, the Host header of a request, names this machine. Numeric addresses are
        accepted too, because DNS rebinding is not possible without a DNS name. If the server listens only on
        this machine, only loopback addresses are accepted."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self._names:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return address.is_loopback or not self.local

    def _knows_token(self, query: str, cookies: str) -> bool:
        given = [query]
        for cookie in cookies.split(";"):
            name, _, value = cookie.strip().partition("=")
            if name == self._cookie:
                given.append(value)
        return any(secrets.compare_digest(text.encode(), self.token.encode()) for text in given)


def _bounded() -> type[ServerConnection]:
    """Returns a class for the connections of one server, which limits their number."""
    limit = ConnectionLimit()

    class Bounded(ServerConnection):
        """A client's connection to the server. The server may close it if there are too many connections. The
        connection is untrusted until its first request is permitted."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            super().connection_made(transport)
            assert isinstance(transport, asyncio.WriteTransport)
            self.counted = limit.add(transport.abort)

        def data_received(self, data: bytes) -> None:
            if self.counted.verified:
                self.counted.mark_verified()
            super().data_received(data)

        def connection_lost(self, exc: Exception | None) -> None:
            limit.remove(self.counted)
            super().connection_lost(exc)

    return Bounded


class LoopEvent(asyncio.Event):
    """An event that only the thread of the event loop may set. Other threads must use `call_soon_threadsafe`.

    viser sets this event, which wakes its sender, in two ways: by the safe call, and directly from other
    threads. The direct call may come after the sender has found the event unset, but before the sender waits
    for the event. The safe call, which follows, then finds the event already set and wakes nobody. In this
    case the sender waits for ever, and the page gets no more updates, although messages from the page still
    arrive.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._home = loop

    def set(self) -> None:
        """Sets the event, like `asyncio.Event.set`, if the event loop's thread calls this method. Calls from
        other threads have no effect."""
        if asyncio._get_running_loop() is self._home:
            super().set()


def close_server(server: viser.ViserServer) -> None:
    """Stops the server, and suppresses the text that viser would print."""
    with redirect_stdout(StringIO()):
        server.stop()


def _adapt_page(response: Response, title: str) -> None:
    """Sets the title of the HTML page in `response`, and adds a script that shows a message on the page when
    the server has ended."""
    if not response.headers.get("Content-Type", "").startswith("text/html"):
        return
    script = f"<script>{SCRIPT}</script></head>".encode()
    named = re.sub(rb"<title>.*?</title>", b"", response.body, count=1)
    response.body = named.replace(b"</head>", f"<title>{escape(title)}</title>".encode() + script, 1)
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))


def _query_token(request: Request) -> str:
    return parse_qs(urlsplit(request.path).query).get("token", [""])[0]


def open_server(
    host: str, port: int, *, label: str, title: str = "TCI", touched: Touched | None = None
) -> tuple[viser.ViserServer, Guard, str]:
    """Opens a viser server with access control. Returns the server, the guard, and the address of the page.

    `label` is the heading of the page's panel, and `title` is the title of the browser's tab. `touched`
    handles the web sockets of fingers on the page. If the host is not the loopback interface, creates a token
    that clients need. Raises DriverError if the port is in use, or if the host is not an address of this
    machine.
    """
    # The library refuses malformed requests. Its log is off, because users do not need a traceback for each
    # of these requests.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    guard = Guard(host, "" if host in LOOPBACK else secrets.token_urlsafe(24), title=title)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listener = socket.create_server((host, port), family=family)
    except OSError as error:
        raise DriverError(
            f"port {port} of {host}: {os.strerror(error.errno or 0)}; valid: a free port, or 0"
        ) from error
    bound = listener.getsockname()[1]
    serve = websockets.asyncio.server.serve
    guarded: list[bool] = []

    def serve_guarded(
        handler: Any, _host: str, _port: int, *, process_request: Answer, **options: Any
    ) -> Any:
        guarded.append(True)

        async def handle(connection: ServerConnection) -> None:
            if connection.request is None or urlsplit(connection.request.path).path != TOUCH:
                await handler(connection)
            elif touched is not None:
                await touched(connection)

        return serve(
            handle, sock=listener, process_request=guard.wrap(process_request), open_timeout=PATIENCE,
            create_connection=_bounded(), **options,
        )  # fmt: skip

    # viser has no hook for a check of requests. If a port is in use, viser uses the next port.
    with _patching:
        websockets.asyncio.server.serve = serve_guarded  # type: ignore[assignment,misc]  # see above
        try:
            with redirect_stdout(StringIO()):  # the library would print an address without the token
                server = viser.ViserServer(host=host, port=bound, label=label, verbose=False)
        finally:
            websockets.asyncio.server.serve = serve  # type: ignore[misc]  # see above
    if not guarded:
        server.stop()
        raise TciError("this version of viser opens its server unguarded; install the one that tci names")
    buffer = server._websock_server._broadcast_buffer
    before, buffer.message_event = buffer.message_event, LoopEvent(server.get_event_loop())
    server.get_event_loop().call_soon_threadsafe(before.set)  # a page may already be connected
    shown = f"[{host}]" if ":" in host else {"0.0.0.0": socket.gethostname()}.get(host, host)
    suffix = f"/?token={guard.token}" if guard.token else ""
    return server, guard, f"http://{shown}:{bound}{suffix}"
