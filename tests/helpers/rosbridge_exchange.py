"""Recorded messages between a genuine rosbridge server and TCI's client, replayed in the tests.

python -m helpers.rosbridge_exchange PORT (in `tests/`)

records the messages again. This needs rosbridge_server with rosapi at PORT of this machine, connected to the
robot of `ros1_robot.py` or `ros2_robot.py` with only the patches of `narrow`.
"""

from __future__ import annotations

import asyncio
import json
import sys
import threading
import time
from typing import Any

import tci
from helpers import TESTS
from tci.robot.description import Robot

FILE = TESTS / "wires" / "ros" / "data" / "rosbridge_ros1.jsonl"
PATCHES = ("left_forearm", "right_forearm")


def plain(message: dict[str, Any]) -> dict[str, Any]:
    """Returns a message without the values that differ in each run: message numbers, times and angles."""
    shown = {key: value for key, value in message.items() if key != "id"}
    if shown["op"] == "publish":
        shown["msg"] = json.loads(json.dumps(message["msg"]))
        for point in shown["msg"].get("points", ()):
            point["positions"] = len(point["positions"])
    return shown


def exchange() -> list[tuple[float, str, dict[str, Any]]]:
    """Returns the recorded messages: time [s], sender (`client` or `server`), and the message."""
    lines = [json.loads(line) for line in FILE.read_text().splitlines()]
    return [(line["time"], line["from"], line["message"]) for line in lines]


def narrow() -> Robot:
    """Returns the NAO with only the patches that were recorded."""
    robot = tci.load_robot("nao")
    return robot.model_copy(update={"patches": tuple(p for p in robot.patches if p.name in PATCHES)})


def _key(call: dict[str, Any]) -> str:
    """Returns the key of a service call, which is the request without its number."""
    return f"{call['service']} {json.dumps(call['args'])}"


class RecordedServer:
    """Replays the genuine server's answers. `heard` contains the client's messages."""

    def __init__(self, port: int = 0) -> None:
        self.heard: list[dict[str, Any]] = []
        self.port = port
        self.left = threading.Event()
        """Set when a client has disconnected, for any reason."""
        self._ready = threading.Event()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        assert self._ready.wait(10.0)

    def close(self) -> None:
        """Closes the server without a farewell, as if it had been killed."""
        if self._loop.is_closed():
            return
        self._loop.call_soon_threadsafe(self._stop)
        self._thread.join(10.0)

    def _run(self) -> None:
        from autobahn.asyncio.websocket import WebSocketServerFactory, WebSocketServerProtocol

        asked = {
            m["id"]: _key(m) for _, who, m in exchange() if who == "client" and m["op"] == "call_service"
        }
        answers = {asked[m["id"]]: m for _, who, m in exchange() if m["op"] == "service_response"}
        published = [(t, m) for t, who, m in exchange() if who == "server" and m["op"] == "publish"]
        outer = self

        class Protocol(WebSocketServerProtocol):
            def onOpen(self) -> None:
                self.topics: set[str] = set()
                outer.protocol = self
                outer.task = asyncio.ensure_future(self.play())

            def onClose(self, wasClean: bool, code: int | None, reason: str | None) -> None:
                outer.left.set()

            def onMessage(self, payload: bytes, isBinary: bool) -> None:
                message = json.loads(payload)
                outer.heard.append(message)
                if message["op"] == "call_service":
                    self.say({**answers[_key(message)], "id": message["id"]})
                elif message["op"] == "subscribe":
                    self.topics.add(message["topic"])

            def say(self, message: dict[str, Any]) -> None:
                self.sendMessage(json.dumps(message).encode())

            async def play(self) -> None:
                """Publishes all recorded messages repeatedly, with increasing times."""
                turn, span = 0, published[-1][0] - published[0][0] + 0.01
                while True:
                    begin = time.monotonic()
                    for when, message in published:
                        await asyncio.sleep(max(0.0, begin + when - published[0][0] - time.monotonic()))
                        if message["topic"] in self.topics:
                            stamp = message["msg"]["header"]["stamp"]
                            later = stamp["secs"] + stamp["nsecs"] * 1e-9 + turn * span
                            again = json.loads(json.dumps(message))
                            whole = int(later)
                            again["msg"]["header"]["stamp"] = {
                                "secs": whole,
                                "nsecs": int((later - whole) * 1e9),
                            }
                            self.say(again)
                    turn += 1

        asyncio.set_event_loop(self._loop)
        factory = WebSocketServerFactory()
        factory.protocol = Protocol
        server = self._loop.run_until_complete(self._loop.create_server(factory, "127.0.0.1", self.port))
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        self._loop.run_forever()
        server.close()
        self._loop.close()

    def _stop(self) -> None:
        if (task := getattr(self, "task", None)) is not None:
            task.cancel()
        protocol = getattr(self, "protocol", None)
        if protocol is not None and protocol.transport is not None:  # still connected
            protocol.transport.abort()
        self._loop.call_later(0.1, self._loop.stop)


def record(port: int) -> None:
    """Connects TCI's driver to a genuine server, moves the robot for a second, and records the messages."""
    from roslibpy.comm import comm_asyncio

    lines: list[str] = []
    begin = time.monotonic()

    def keep(who: str, payload: bytes | str) -> None:
        line = {"time": round(time.monotonic() - begin, 4), "from": who, "message": json.loads(payload)}
        lines.append(json.dumps(line))

    protocol = comm_asyncio.AsyncioRosBridgeProtocol
    sent, received = protocol._send, protocol.onMessage

    def send(self: Any, payload: bytes) -> None:
        keep("client", payload)
        sent(self, payload)

    def receive(self: Any, payload: bytes, isBinary: bool) -> None:
        keep("server", payload)
        received(self, payload, isBinary)

    protocol._send, protocol.onMessage = send, receive
    with tci.connect(narrow(), f"rosbridge:127.0.0.1:{port}", arm=True, wait=20.0) as driver:
        pending = [driver.native("LArm").command({"LElbowRoll": -1.2})]
        for now in driver.ticks(duration=0.6):
            driver.write(driver.gate.step(pending, driver.read().joints, now))
            pending = []
    FILE.parent.mkdir(exist_ok=True)
    FILE.write_text("\n".join(lines) + "\n")
    print(f"{FILE}: {len(lines)} messages, {FILE.stat().st_size} bytes")


if __name__ == "__main__":
    record(int(sys.argv[1]))
