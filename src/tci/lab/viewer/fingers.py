"""Fingers and mice of all pages: what they do on the skin of simulated robots is a poke, press or stroke."""

from __future__ import annotations

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import viser
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from tci.body.places import Place
from tci.lab.viewer.pick import ray
from tci.messages.frames import Array

HELD = 0.25
"""Time [s] after which a finger that is not lifted presses; before, it was a poke. Assumed: a click is
shorter."""
MOVED = 0.01
"""Way of a finger, as a fraction of the picture, from which it strokes. Assumed: a click moves less."""
PATIENCE, FIRMER, MOST = 1.0, 2.0, 20.0
"""A finger that holds still for `PATIENCE` [s] presses firmer by `FIRMER` [N/s], up to `MOST` [N]. Assumed:
slow enough to stop in time."""
LEAST = 0.2
"""Least force [N] that a page can ask for."""
NOTCH = 1.15
"""Factor of the force for a notch of the wheel."""
WAITING = 500
"""Messages that wait for the drawing thread. Of a page that sends more, the oldest are lost."""
KINDS = ("down", "move", "up", "wheel")

Finger = tuple[int, int]
"""Number of the connection and of the pointer on its page."""


@dataclass(slots=True)
class _Down:
    key: str
    place: Place
    at: tuple[float, float]
    camera: viser.CameraHandle
    began: float
    before: float
    """Time [s] of the latest look."""
    still: float
    """Since when it has not moved [s]."""
    factor: float = 1.0
    """By the wheel."""
    extra: float = 0.0
    """What holding still has added [N]."""
    touches: bool = False


@dataclass(slots=True, eq=False)
class Fingers:
    """`handle` runs in the server's thread, `update` in the thread that draws."""

    clients: Callable[[], dict[int, viser.ClientHandle]]
    pick: Callable[[Array, Array], tuple[str, Place] | None]
    force: Callable[[], float]
    """Force [N] of the slider."""
    poke: Callable[[str, Place], None]
    touch: Callable[[str, Finger, Place, float], None]
    let_go: Callable[[str, Finger], None]
    _inbox: deque[tuple[int, Callable[[str], None], dict[str, Any]]] = field(
        default_factory=lambda: deque(maxlen=WAITING)
    )
    _gone: deque[int] = field(default_factory=deque)
    _down: dict[Finger, _Down] = field(default_factory=dict)
    _connections: int = 0

    async def handle(self, connection: ServerConnection) -> None:
        """Reads one page until it closes. A message that is no finger's ends the connection."""
        self._connections += 1
        number, loop = self._connections, asyncio.get_running_loop()

        def answer(words: str) -> None:
            asyncio.run_coroutine_threadsafe(_send(connection, words), loop)

        try:
            with suppress(ConnectionClosed):
                async for message in connection:
                    if (said := _understood(message)) is None:
                        break
                    self._inbox.append((number, answer, said))
        finally:
            self._gone.append(number)

    def update(self) -> None:
        """Does what the pages have said since the last call."""
        now, moved = time.monotonic(), dict[Finger, tuple[float, float]]()
        while self._inbox:
            number, answer, said = self._inbox.popleft()
            finger = number, int(said["pointer"])
            if said["is"] == "down":
                answer(json.dumps({"pointer": finger[1], "skin": self._begin(finger, said, now)}))
            elif finger not in self._down:
                continue
            elif said["is"] == "wheel":
                self._down[finger].factor *= NOTCH if said["y"] > 0.0 else 1.0 / NOTCH
            else:
                moved[finger] = float(said["x"]), float(said["y"])
                if said["is"] == "up":
                    self._go(finger, moved.pop(finger), now)
                    self._lift(finger)
        for finger, one in self._down.items():
            self._go(finger, moved.get(finger, one.at), now)
        while self._gone:
            number = self._gone.popleft()
            for finger in [one for one in self._down if one[0] == number]:
                self._lift(finger)

    def _begin(self, finger: Finger, said: dict[str, Any], now: float) -> bool:
        clients = self.clients()
        # The page's number comes with the first drawing of its panel; one page alone is known without it.
        alone = next(iter(clients.values())) if len(clients) == 1 else None
        client = clients.get(int(said.get("client", -1)), alone)
        at = float(said["x"]), float(said["y"])
        hit = None if client is None else self.pick(*ray(client.camera, *at))
        if client is None or hit is None:
            return False
        self._down[finger] = _Down(*hit, at, client.camera, began=now, before=now, still=now)
        return True

    def _go(self, finger: Finger, to: tuple[float, float], now: float) -> None:
        one = self._down[finger]
        way = max(abs(to[0] - one.at[0]), abs(to[1] - one.at[1]))
        if way > (0.0 if one.touches else MOVED):
            hit = self.pick(*ray(one.camera, *to))
            one.at, one.still, one.touches = to, now, True
            if hit is not None and hit[0] == one.key:
                one.place = hit[1]
        elif now - one.still > PATIENCE:
            one.extra = min(one.extra + FIRMER * (now - one.before), MOST)
        one.before, one.touches = now, one.touches or now - one.began > HELD
        if one.touches:
            asked = min(max((self.force() + one.extra) * one.factor, LEAST), MOST)
            self.touch(one.key, finger, one.place, asked)

    def _lift(self, finger: Finger) -> None:
        one = self._down.pop(finger)
        if one.touches:
            self.let_go(one.key, finger)
        else:
            self.poke(one.key, one.place)


def _understood(message: str | bytes) -> dict[str, Any] | None:
    """A page's message, or None if it is none."""
    try:
        said: Any = json.loads(message) if len(message) < 400 else None
        kind, wanted = said["is"], ("pointer", "y") if said["is"] == "wheel" else ("pointer", "x", "y")
        numbers = [said[name] for name in wanted] + [said.get("client", -1)]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
    fine = kind in KINDS and all(isinstance(one, int | float) and abs(one) < 1e9 for one in numbers)
    return said if fine else None


async def _send(connection: ServerConnection, words: str) -> None:
    with suppress(ConnectionClosed):
        await connection.send(words)
