"""`zenoh[:[NAME@]WHERE]`: a robot that `tci serve --via zenoh` serves to any number of other processes.

| key | content | from |
|---|---|---|
| `tci/NAME/state` | joints, gate, commander; in every period | robot |
| `tci/NAME/skin/PATCH` | each new frame of the patch | robot |
| `tci/NAME/orders/CLIENT` | orders and heartbeat, signed; in every period | behaviour |
| `tci/NAME/join` | reply to `?client=NUMBER`: the secret with which it signs, given once | robot |
| `tci/NAME/free` | reply to an operator's query: it moves away from whom it presses, or why not | robot |
| `tci/NAME/facts` | the robot's facts as JSON, as reply to a query | robot |
| `tci/NAME/alive` | liveliness of the robot's process | robot |
"""

from __future__ import annotations

import hmac
import math
import secrets
from collections.abc import Iterable, Iterator
from typing import Any

import zenoh

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.driver import Driver
from tci.drivers.remote.driver import RemoteDriver
from tci.drivers.remote.encoding import frame_bytes, orders_bytes, state_bytes, to_orders, to_skin, to_state
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.drivers.remote.server import RemoteServer
from tci.errors import CommandError, DriverError, FrameError, TciError
from tci.exports.facts import query, read_facts
from tci.messages import SkinFrame
from tci.robot.description import Robot, wire_name
from tci.shared.own_sockets import ConnectionMonitor, listening
from tci.wires.zenoh.session import close_session, open_session, parse_address

PER_POLL = 16
"""Largest number of messages that one call reads. If more messages have arrived, the older messages are
dropped. The number bounds the time of a call. Assumed: usually fewer messages have arrived."""
ASKS_AGAIN = 0.5
"""Time [s] after which a commander asks again for its secret."""
MOST_SECRETS = 256
"""Largest number of secrets that a server keeps, those of its present commanders always."""
QOS: dict[str, Any] = {
    # a dropped message does no harm, since orders are repeated; waiting would delay the loop
    "congestion_control": zenoh.CongestionControl.DROP,
    "priority": zenoh.Priority.REAL_TIME,
    "express": True,
}


class ZenohDriver(RemoteDriver):
    """Driver of a robot that another process serves through Zenoh."""

    def __init__(self, robot: Robot, address: str = "", *, arm: bool = False) -> None:
        """Connects to the robot's process. Raises DriverError if no process at `address` serves this
        robot."""
        self._address = parse_address(address, robot.name)
        super().__init__(robot, middleware="zenoh", place=str(self._address), arm=arm)
        self.session = open_session(self._address, "connect")
        """Session of Zenoh, with which the robot's facts at `tci/NAME/facts` can be queried."""
        key = self._key = f"tci/{self._address.robot}"
        self._why = ""
        self._secret: tuple[int, bytes] | None = None  # with the session to which it belongs
        self._asked = -math.inf
        patches = max(1, len(robot.skin))
        try:
            self._states = self.session.declare_subscriber(f"{key}/state", zenoh.handlers.RingChannel(1))
            self._frames = self.session.declare_subscriber(
                f"{key}/skin/*", zenoh.handlers.RingChannel(2 * patches)
            )
            self._orders = self.session.declare_publisher(f"{key}/orders/{self.client:x}", **QOS)
            self._wait()
        except BaseException:
            close_session(self.session)
            raise

    @classmethod
    def probe(cls, robot: Robot, address: str) -> tuple[Finding, ...]:
        try:
            where = parse_address(address, robot.name)
            session = open_session(where, "connect")
        except DriverError as error:
            advice = "start tci serve or the router there; with TLS check that key and certificate fit"
            return (Finding(Level.FAULT, "session", str(error), advice),)
        try:
            return (Finding(Level.OK, "session", f"open at {where}"), *_look(session, robot, where.robot))
        finally:
            close_session(session)

    def _poll(self) -> Iterator[State | SessionFrame]:
        for subscriber, read in ((self._states, to_state), (self._frames, to_skin)):
            for sample in _received(subscriber):
                try:
                    yield read(self.robot, sample.payload.to_bytes())
                except FrameError as error:
                    self.rejected += 1
                    self._why = str(error)

    def _put(self, orders: Orders) -> None:
        """Sends nothing before the robot's process has given the secret: it would be refused."""
        try:
            if self._secret is None or self._secret[0] != orders.session:
                self._ask(orders.session)
                return
            data = orders_bytes(self.robot, orders)
            self._orders.put(data, attachment=_signature(self._secret[1], data))
        except zenoh.ZError as error:
            raise DriverError(f"{self.place}: {error}") from error

    def _ask(self, session: int) -> None:
        """Asks the robot's process for the secret with which orders are signed. The answer comes later."""

        def take(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self._secret = session, reply.ok.payload.to_bytes()

        if self.clock.now() - self._asked >= ASKS_AGAIN:
            self._asked = self.clock.now()
            self.session.get(f"{self._key}/join?client={self.client:x}", take)

    def _why_silent(self) -> str:
        if self._why:
            return self._why
        there = ", ".join(_alive(self.session)) or "none"
        return f"robots served there: {there}; to serve one: tci serve ROBOT --via zenoh"

    def _starting(self) -> bool:
        return not self._why and self._address.robot in _alive(self.session)

    def _close(self) -> None:
        super()._close()
        close_session(self.session)


class ZenohServer(RemoteServer):
    """Serves a robot through Zenoh."""

    def __init__(self, driver: Driver, address: str = "") -> None:
        """Listens at `address`. Raises DriverError if the address can't be used."""
        super().__init__(driver, address, middleware="zenoh")
        self._where = parse_address(address, driver.robot.name)
        self._key = f"tci/{self._where.robot}"
        facts = query(driver.robot).model_dump_json()
        before = listening()
        self.session = open_session(self._where, "listen")
        """Session of Zenoh."""
        self._monitors = [ConnectionMonitor(port) for port in listening() - before]
        self.rejected = 0
        """Number of received messages without valid orders for this robot, or without the signature of the
        commander whose number they have."""
        self._secrets: dict[int, bytes] = {}
        self._orders = self.session.declare_subscriber(
            f"{self._key}/orders/*", zenoh.handlers.RingChannel(PER_POLL)
        )
        self._states = self.session.declare_publisher(f"{self._key}/state", **QOS)
        self._frames = {
            patch.name: self.session.declare_publisher(f"{self._key}/skin/{wire_name(patch.name)}", **QOS)
            for patch in driver.robot.skin
        }
        # the answer has the robot's own key, since a query may have the key tci/*/facts
        key = f"{self._key}/facts"
        self._facts = self.session.declare_queryable(
            key, lambda asked: asked.reply(key, facts, encoding=zenoh.Encoding.APPLICATION_JSON)
        )
        self._joins = self.session.declare_queryable(f"{self._key}/join", self._admit)
        self._frees = self.session.declare_queryable(f"{self._key}/free", self._free)
        self._alive = self.session.liveliness().declare_token(f"{self._key}/alive")

    def where(self) -> str:
        return str(self._where)

    def _poll(self) -> Iterable[Orders]:
        for sample in _received(self._orders):
            data = sample.payload.to_bytes()
            try:
                orders = to_orders(self.driver.robot, data)
            except FrameError:
                self.rejected += 1
                continue
            secret = self._secrets.get(orders.client, b"")
            signature = b"" if sample.attachment is None else sample.attachment.to_bytes()
            if secret and hmac.compare_digest(signature, _signature(secret, data)):
                yield orders
            else:
                self.rejected += 1

    def _admit(self, asked: zenoh.Query) -> None:
        """Gives a commander, once, the secret with which it signs its orders. Everybody can read the numbers
        of commanders, in each state, and Zenoh doesn't tell who sent a message."""
        try:
            client = int(asked.parameters.get("client") or "", 16)
        except ValueError:
            client = 0
        if client == 0 or client in self._secrets:
            asked.reply_err(b"valid: a new commander's number, as client=HEXADECIMAL")
            return
        there = {commander.client for commander in self.commanders.states()}
        for old in [one for one in self._secrets if one not in there][
            : len(self._secrets) - MOST_SECRETS + 1
        ]:
            del self._secrets[old]
        secret = self._secrets[client] = secrets.token_bytes(32)
        asked.reply(f"{self._key}/join", secret)

    def _free(self, asked: zenoh.Query) -> None:
        """Frees whom the robot presses, with its next reading. Runs in a thread of Zenoh."""
        try:
            if not self.driver.armed:
                raise CommandError("this robot is served read-only; valid: tci serve --arm")
            self.driver.gate.free()
        except CommandError as error:
            asked.reply_err(str(error))
        else:
            asked.reply(f"{self._key}/free", "moves away")

    def _show(self, state: State) -> None:
        self._states.put(state_bytes(self.driver.robot, state))

    def _show_skin(self, frame: SkinFrame) -> None:
        self._frames[frame.patch].put(frame_bytes(self.driver.robot, SessionFrame(self.number, frame)))

    def close(self) -> None:
        for monitor in self._monitors:
            monitor.close()
        close_session(self.session)


def _alive(session: zenoh.Session) -> list[str]:
    """Returns the names of all robots that the session can reach."""
    found = session.liveliness().get("tci/*/alive", timeout=1.0)
    return sorted(str(reply.ok.key_expr).split("/")[1] for reply in found if reply.ok is not None)


def _look(session: zenoh.Session, robot: Robot, name: str) -> Iterator[Finding]:
    """Yields findings on two questions: if a robot `name` is served, and if the process that serves it has
    the description `robot`."""
    names = _alive(session)
    if name not in names:
        said = f"{name} is not served; robots served there: {', '.join(names) or 'none'}"
        yield Finding(
            Level.FAULT, "robot", said, "serve it (tci serve ROBOT --via zenoh), or get access to its keys"
        )
        return
    yield Finding(Level.OK, "robot", f"{name} is alive")
    for reply in session.get(f"tci/{name}/facts", timeout=2.0):
        if reply.ok is not None:
            try:
                same = read_facts(reply.ok.payload.to_string()).digest == robot.digest
            except (TciError, ValueError) as error:
                yield Finding(Level.FAULT, "description", f"its answer is no description: {error}")
                return
            advice = "" if same else "use the same description on both machines: tci check FILE"
            said = "the same on both sides" if same else "different on the two sides"
            yield Finding(Level.OK if same else Level.FAULT, "description", said, advice)
            return
    yield Finding(Level.WARNING, "description", "it does not answer tci/NAME/facts", "get access to that key")


def _signature(secret: bytes, data: bytes) -> bytes:
    return hmac.digest(secret, data, "sha256")


def _received(
    subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]],
) -> Iterator[zenoh.Sample]:
    """Yields the messages that have arrived, the oldest first, at most a fixed number."""
    for _ in range(PER_POLL):
        sample = subscriber.try_recv()
        if sample is None:
            return
        yield sample
