"""A rosbridge server without ROS: it passes messages from publishing clients to subscribing clients.

Neither Debian nor PyPI has the genuine server. This server sends the answers of the genuine server that
`rosbridge_exchange` recorded, and connects the topics of its clients. Run as a program, it prints its port
number, and ends when its standard input ends.
"""

from __future__ import annotations

import asyncio
import json
import sys
import time
from typing import Any

from autobahn.asyncio.websocket import WebSocketServerFactory, WebSocketServerProtocol

MOST_WAITING = 1 << 20
"""Largest number of bytes that may wait for a slow client. Further messages to this client are dropped."""


class Client(WebSocketServerProtocol):
    """Connection to one client."""

    everybody: set[Client] = set()  # noqa: RUF012 - one set for the process is intended

    def onOpen(self) -> None:
        self.offers: dict[str, str] = {}
        self.latched: dict[str, str | None] = {}
        self.hears: set[str] = set()
        self.everybody.add(self)

    def onClose(self, wasClean: bool, code: int | None, reason: str | None) -> None:
        self.everybody.discard(self)

    def onMessage(self, payload: bytes, isBinary: bool) -> None:
        said = json.loads(payload)
        getattr(self, f"on_{said['op']}")(said)

    def on_advertise(self, said: dict[str, Any]) -> None:
        self.offers[said["topic"]] = said["type"]
        if said.get("latch"):
            self.latched.setdefault(said["topic"], None)

    def on_unadvertise(self, said: dict[str, Any]) -> None:
        self.offers.pop(said["topic"], None)
        self.latched.pop(said["topic"], None)

    def on_publish(self, said: dict[str, Any]) -> None:
        topic = said["topic"]
        text = json.dumps({"op": "publish", "topic": topic, "msg": said["msg"]})
        if topic in self.latched:
            self.latched[topic] = text
        for client in self.everybody:
            if topic in client.hears:
                client.say(text)

    def on_subscribe(self, said: dict[str, Any]) -> None:
        self.hears.add(said["topic"])
        for client in self.everybody:
            if text := client.latched.get(said["topic"]):
                self.say(text)

    def on_unsubscribe(self, said: dict[str, Any]) -> None:
        self.hears.discard(said["topic"])

    def on_call_service(self, said: dict[str, Any]) -> None:
        topic = said.get("args", {}).get("topic", "")
        types = [client.offers[topic] for client in self.everybody if topic in client.offers]
        now = time.time()
        values = {
            "/rosapi/get_time": {"time": {"secs": int(now), "nsecs": int(now % 1 * 1e9)}},
            "/rosapi/publishers": {"publishers": [f"/client_{n}" for n in range(len(types))]},
            "/rosapi/topic_type": {"type": types[0] if types else ""},
        }[said["service"]]
        answer = {"op": "service_response", "service": said["service"], "values": values, "result": True}
        self.say(json.dumps({**answer, "id": said["id"]}))

    def say(self, text: str) -> None:
        if self.transport is not None and self.transport.get_write_buffer_size() < MOST_WAITING:
            self.sendMessage(text.encode())


async def main() -> None:
    factory = WebSocketServerFactory()
    factory.protocol = Client
    loop = asyncio.get_running_loop()
    server = await loop.create_server(factory, "127.0.0.1", 0)
    print(server.sockets[0].getsockname()[1], flush=True)
    await loop.run_in_executor(None, sys.stdin.read)


if __name__ == "__main__":
    asyncio.run(main())
