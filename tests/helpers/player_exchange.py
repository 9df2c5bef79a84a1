"""Recorded messages between genuine Player 3.1.1 and TCI, replayed in the tests.

In `tests/`, with a genuine server at PORT for TCI's driver, or a genuine client at PORT and TCI's server at
TO,

    python -m helpers.player_exchange client PORT
    python -m helpers.player_exchange server PORT TO

record the messages again. The genuine server has `passthrough` drivers, which connect it to the NAO of `tci
serve nao --via player` (opaque:1 is the right forearm). The server is recorded twice: with TCI's driver as
its client, and as a client of TCI's server.
"""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections import Counter

from helpers import TESTS
from helpers.rosbridge_exchange import narrow
from tci.wires.player.wire import GREETING, PLAYER, SUBSCRIBE, Message, MessageKind, Stream, to_access

MOST_DATA = 20
"""Largest number of recorded data messages of each device."""
FOLDER = TESTS / "wires" / "player" / "data"


def said(name: str) -> list[tuple[float, str, bytes]]:
    """Returns the recorded messages: time [s], sender (`client` or `server`), and the bytes of a whole
    message or the greeting."""
    lines = [json.loads(line) for line in (FOLDER / f"player_{name}.jsonl").read_text().splitlines()]
    return [(line["time"], line["from"], bytes.fromhex(line["bytes"])) for line in lines]


def read(data: bytes) -> Message:
    """Reads a whole message and returns it."""
    (message,) = Stream().feed(data)
    return message


def gist(message: Message) -> tuple[object, ...]:
    """Returns a message without times and port numbers. For a command, returns only its length."""
    body: object = len(message.body) if message.kind == MessageKind.COMMAND else message.body
    if (message.interface, message.subtype) == (PLAYER, SUBSCRIBE):
        body = to_access(message.body)
    return message.interface, message.index, message.kind, message.subtype, body


class RecordedServer:
    """Replays the genuine server's answers and, repeatedly, its data. `heard` contains the client's
    messages."""

    def __init__(self) -> None:
        self.heard: list[Message] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._connection: socket.socket | None = None
        self._closed = threading.Event()
        self._threads = [threading.Thread(target=self._serve, daemon=True)]
        self._threads[0].start()

    def close(self) -> None:
        """Closes the server without a farewell, as if it had been killed."""
        self._closed.set()
        self._listener.close()
        if self._connection is not None:
            self._connection.close()
        for thread in self._threads:
            thread.join(5.0)

    def send(self, data: bytes) -> None:
        """Sends arbitrary bytes."""
        assert self._connection is not None
        self._connection.sendall(data)

    def _serve(self) -> None:
        lines = said("client")
        self._connection, _ = self._listener.accept()
        greeting = next(data for _, who, data in lines if who == "server")
        self.send(greeting)
        messages = [(t, who, read(data)) for t, who, data in lines if data != greeting]
        asked = [gist(m) for _, who, m in messages if who == "client" and m.kind == MessageKind.REQUEST]
        answers = [m for _, _, m in messages if m.kind == MessageKind.ACK]
        data = [(t, m) for t, who, m in messages if who == "server" and m.kind == MessageKind.DATA]
        self._threads.append(threading.Thread(target=self._publish, args=(data,), daemon=True))
        self._threads[-1].start()
        stream = Stream()
        try:
            while chunk := self._connection.recv(4096):
                for message in stream.feed(chunk):
                    self.heard.append(message)
                    if message.kind == MessageKind.REQUEST:
                        self.send(answers[asked.index(gist(message))].to_bytes())
        except OSError:
            return

    def _publish(self, data: list[tuple[float, Message]]) -> None:
        turn, span = 0, data[-1][0] - data[0][0] + 0.01
        while True:
            begin = time.monotonic()
            for when, message in data:
                if self._closed.wait(max(0.0, begin + when - data[0][0] - time.monotonic())):
                    return
                later = Message(
                    message.interface, message.index, message.kind, message.subtype,
                    message.stamp + turn * span, message.body,
                )  # fmt: skip
                try:
                    self.send(later.to_bytes())
                except OSError:
                    return
            turn += 1


class Tap:
    """Proxy between a client and a server that records each message."""

    def __init__(self, name: str, port: int, to: int) -> None:
        self.name, self._begin, self._lines = name, time.monotonic(), list[str]()
        self._data: Counter[tuple[int, int]] = Counter()
        self._lock = threading.Lock()
        listener = socket.create_server(("127.0.0.1", port))
        self.port: int = listener.getsockname()[1]
        threading.Thread(target=self._accept, args=(listener, to), daemon=True).start()

    def save(self) -> None:
        """Writes the recorded messages to a file."""
        FOLDER.mkdir(exist_ok=True)
        path = FOLDER / f"player_{self.name}.jsonl"
        path.write_text("\n".join(self._lines) + "\n")
        print(f"{path}: {len(self._lines)} messages, {path.stat().st_size} bytes")

    def _accept(self, listener: socket.socket, to: int) -> None:
        while True:
            client, _ = listener.accept()
            server = socket.create_connection(("127.0.0.1", to))
            for who, one, other in (("client", client, server), ("server", server, client)):
                threading.Thread(target=self._carry, args=(who, one, other), daemon=True).start()

    def _carry(self, who: str, one: socket.socket, other: socket.socket) -> None:
        stream, greeted = Stream(), who == "client"
        while data := one.recv(1 << 16):
            other.sendall(data)
            if not greeted:
                self._keep(who, data[:GREETING])
                data, greeted = data[GREETING:], True
            for message in stream.feed(data):
                device = message.interface, message.index
                self._data[device] += message.kind == MessageKind.DATA
                if message.kind != MessageKind.DATA or (
                    self.name == "client" and self._data[device] <= MOST_DATA
                ):
                    self._keep(who, message.to_bytes())

    def _keep(self, who: str, data: bytes) -> None:
        with self._lock:
            line = {"time": round(time.monotonic() - self._begin, 4), "from": who, "bytes": data.hex()}
            self._lines.append(json.dumps(line))


def main() -> None:
    import tci

    what, port = sys.argv[1], int(sys.argv[2])
    if what == "client":
        tap = Tap("client", 0, port)
        with tci.connect(narrow(), f"player:127.0.0.1:{tap.port}", arm=True) as driver:
            pending = [driver.native("LArm").command({"LElbowRoll": -1.1})]
            for now in driver.ticks(duration=0.5):
                driver.write(driver.gate.step(pending, driver.read().joints, now))
                pending = []
    else:
        tap = Tap("server", port, int(sys.argv[3]))
        input("Start the genuine server and its client now; then press Enter.")
    tap.save()


if __name__ == "__main__":
    main()
