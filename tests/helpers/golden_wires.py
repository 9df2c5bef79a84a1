"""What each wire says for fixed commands and a fixed reading, at its last stage before the socket.

`python -m helpers.golden_wires NAME...` in `tests/` records wires again ("all": all of them). Do this only
after an intended change of messages, and mention the change in the commit message.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np

import tci
from helpers import TESTS
from helpers.remote_wire import Wire
from tci.body.perceiver import Perceiver
from tci.drivers.remote import encoding as cdr
from tci.drivers.remote.protocol import Orders, SessionFrame, State
from tci.drivers.remote.server import RemoteServer
from tci.gate.safe_command import GateState, GateToken, SafeCommand
from tci.messages import (
    JointReading,
    ManualClock,
    Mode,
    PlatformCommand,
    PlatformOrder,
    PlatformSwitch,
    Reading,
    SkinFrame,
)
from tci.messages.frames import read_only
from tci.reasons import Code, Reason
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position
from tci.testing import FakeDriver

FOLDER = TESTS / "golden" / "wires"
DIGEST = "0123456789abcdef" * 4
"""Stands for the description's digest, which changes with every description and is no matter of a wire."""
NOW = 100.0
Said = list[Any]
"""Messages in the order in which they are sent: bytes as hexadecimal digits, or fields."""


def robot_of(name: str) -> Robot:
    return tci.load_robot(name).model_copy(update={"digest": DIGEST})


def commands(robot: Robot, modes: Sequence[Mode]) -> list[SafeCommand]:
    """One command of the left arm for each of `modes`, then a hold, each 10 ms after the last."""
    servos = np.array([one.servo for one in robot.part("left_arm").servos if one.servo is not None])
    start = np.array(initial_position(robot))
    found = []
    for number, mode in enumerate([*modes, modes[-1]]):
        hold = number == len(modes)
        step = 0.01 * (number + 1) * np.arange(1, len(servos) + 1)
        moved = mode in (Mode.POSITION, Mode.IMPEDANCE)
        order: PlatformOrder = PlatformCommand(mode, servos, start[servos] + step, np.ones(len(servos)))
        switched = number > 0 and mode is not modes[number - 1] and not hold
        found.append(
            SafeCommand(
                seal=GateToken(robot.name),
                stamp=NOW + 0.01 * number,
                state=GateState.HOLD if hold else GateState.RUN,
                servos=servos,
                modes=(mode,) * len(servos),
                position=read_only(start[servos] + step * moved),
                velocity=read_only(0.1 * step * (mode is not Mode.TORQUE) * (not hold)),
                acceleration=read_only(0.0 * step),
                torque=read_only(step * (mode is Mode.TORQUE)),
                stiffness={int(servos[0]): 0.5} if number == 0 else {},
                damping={int(servos[1]): 0.25} if number == 0 else {},
                clamped=(),
                refusals=(Reason(Code.COMMAND_INVALID, "no such joint"),) if hold else (),
                reason=Reason(Code.JOINTS_STALE, "the joint data is 60 ms old") if hold else None,
                orders=() if hold else (*((PlatformSwitch(servos, mode),) if switched else ()), order),
            )
        )
    return found


def reading(robot: Robot) -> Reading:
    """Joints in motion with torques, and skin whose first taxels are pressed."""
    count = len(robot.servos)
    position = np.array(initial_position(robot)) + 0.001 * np.arange(count)
    joints = JointReading(
        NOW, 7, read_only(position), read_only(0.01 * np.arange(count)), read_only(0.1 * np.arange(count))
    )
    frames = []
    for patch in robot.skin:
        values = np.full(patch.channels, float(patch.sensor.rest))
        values[:3] = np.clip(patch.sensor.rest + np.sign(patch.sensor.pascal_per_count) * 20, 0, 255)
        frames.append(SkinFrame(patch.name, NOW, 5, read_only(values)))
    return Reading(joints, tuple(frames))


class Served:
    """A robot whose clock stands still, and what a server has to show of it."""

    def __init__(self, robot: Robot) -> None:
        self.driver = FakeDriver(robot, clock=ManualClock(NOW))
        self.reading = reading(robot)
        self.perception = Perceiver(tci.GenericBody(robot)).step(self.reading, NOW)
        self.sent = commands(robot, [Mode.POSITION])

    @contextmanager
    def still(self) -> Iterator[None]:
        """Clocks of the process and random numbers of the session that are always the same."""
        with (
            mock.patch.object(time, "monotonic", return_value=NOW),
            mock.patch.object(time, "time", return_value=1.6e9 + NOW),
            mock.patch("secrets.randbits", return_value=41),
        ):
            yield

    def show(self, server: Any) -> None:
        for sent in self.sent:
            server.show(self.reading)
            server.publish(self.reading, self.perception, sent)


def plain(value: Any) -> Any:
    """Values of messages as JSON: bytes and arrays of bytes as hexadecimal digits."""
    if isinstance(value, bytes | bytearray):
        return bytes(value).hex()
    if isinstance(value, np.ndarray):
        return plain(value.tobytes()) if value.dtype == np.uint8 else value.tolist()
    if isinstance(value, Mapping):
        return {str(name): plain(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    return value.item() if isinstance(value, np.generic) else value


# Between TCI processes: Zenoh sends these bytes; ROS and Player pack them into their own messages.


def remote(encode: Any) -> tuple[Said, Said]:
    robot, orders = robot_of("nao"), list[Orders]()

    class Said(Wire):
        def _put(self, sent: Orders) -> None:
            orders.append(sent)

    driver = Said()
    driver.client, driver.name = 5, "here, process 1"
    driver.tell()
    driver.read()
    for safe in commands(robot, [Mode.POSITION, Mode.IMPEDANCE]):
        driver._send(safe)
    shown: list[bytes] = []

    class Shows(RemoteServer):
        def where(self) -> str:
            return "here"

        def _poll(self) -> list[Orders]:
            return []

        def _show(self, state: State) -> None:
            shown.append(encode.state_bytes(robot, state))

        def _show_skin(self, frame: SkinFrame) -> None:
            shown.append(encode.frame_bytes(robot, SessionFrame(self.number, frame)))

        def close(self) -> None:
            return

    served = Served(robot)
    with served.still():
        served.show(Shows(served.driver, middleware="zenoh"))
    return [encode.orders_bytes(robot, one) for one in orders], shown


def lcm() -> tuple[Said, Said]:
    from tci.wires.lcm import encoding

    return remote(encoding)


# ROS 1, ROS 2 and rosbridge: the fields of each message, by topic; the nodes of the three encode them.


def node() -> tuple[Any, dict[str, Callable[..., None]], Said]:
    """A node that keeps what is published, and the callbacks of its topics."""
    from tci.shared.ros_node import RosNode

    published: Said = []
    heard: dict[str, Callable[..., None]] = {}

    class Kept(RosNode):
        def advertise(self, topic: str, kind: Any, *, latched: bool = False) -> Any:
            return lambda values: published.append([topic, kind.name, plain(values)])

        def subscribe(
            self, topic: str, kind: Any, callback: Any, *, latched: bool = False, keep: int = 1
        ) -> None:
            heard[topic] = callback

        def types_of(self, topic: str) -> tuple[str, ...]:
            return ()

        def close(self) -> None:
            return

    return Kept(), heard, published


def ros() -> tuple[Said, Said]:
    from tci.wires.ros.names import Names
    from tci.wires.ros.native import NativeRobot
    from tci.wires.ros.server import RosServer

    robot = robot_of("nao")
    own, heard, written = node()
    names = Names(robot, "ros2", "/left")
    native = NativeRobot(robot, own, names, arm=True, period=0.01, now=lambda: NOW)
    joints = reading(robot).joints
    words = {
        "sec": 100,
        "nanosec": 0,
        "name": [names.joint(servo) for servo in robot.servos],
        "position": joints.position.tolist(),
        "velocity": joints.velocity.tolist(),
        "effort": [],
    }
    heard[names.joints](words)
    for safe in commands(robot, [Mode.POSITION, Mode.POSITION]):
        native.send(safe)
    other, _, shown = node()
    served = Served(robot)
    with served.still():
        served.show(RosServer(served.driver, "", other, middleware="ros2", namespace="/left"))
    facts = ("robot_description", "tci/facts")  # tested with exports
    return written, [one for one in shown if not one[0].endswith(facts)]


# Player: the bodies of the messages, by device.


def player() -> tuple[Said, Said]:
    from tci.wires.player import driver as drivers
    from tci.wires.player.server import PlayerServer

    robot, written = robot_of("nao"), []
    offered = list(drivers.numbers(robot))

    class Client:
        lost = ""

        def __init__(self, host: str, port: int) -> None:
            return

        def devices(self) -> list[tuple[int, int]]:
            return offered

        def open(self, interface: int, index: int) -> None:
            return

        def command(self, interface: int, index: int, subtype: int, body: bytes) -> None:
            written.append([interface, index, subtype, body.hex()])

    with (
        mock.patch.object(drivers, "Client", Client),
        mock.patch.object(drivers.PlayerDriver, "_wait_for_joints"),
    ):
        driver = drivers.PlayerDriver(robot, "", arm=True)
    driver._position[:] = reading(robot).joints.position
    for safe in commands(robot, [Mode.POSITION, Mode.POSITION]):
        driver._send(safe)
    served, shown = Served(robot), []
    with served.still():
        server = PlayerServer(served.driver, ":0")
        try:
            with mock.patch.object(server, "_send_data", lambda *words: shown.append(plain(words))):
                served.show(server)
        finally:
            server.close()
    return written, shown


# Unitree: whole DDS messages.


def unitree() -> tuple[Said, Said]:
    from tci.wires.unitree import server as servers
    from tci.wires.unitree.driver import slots_of
    from tci.wires.unitree.handover import Handover, Phase
    from tci.wires.unitree.motors import SENT, gains
    from tci.wires.unitree.set_points import SetPoints
    from tci.wires.unitree.wire import COMMAND, encode_command

    robot, written = robot_of("g1"), []
    for whole in (False, True):
        points, now = SetPoints(robot, slots_of(robot), whole=whole), NOW
        handover, first = Handover(gains(whole=whole), whole=whole), reading(robot).joints
        _, here = points.here(np.zeros(29), first)
        handover.take(here["q"], now)
        while handover.phase is not Phase.LEADING:
            handover.step(now := now + 0.02)
        for safe in commands(robot, [Mode.POSITION, Mode.TORQUE]):
            chosen, targets = points.of(safe, first)
            handover.follow(chosen, targets, here["q"], now)
            targets = handover.step(now)
            record: Any = np.zeros((), COMMAND)
            record["motor"]["mode"][: len(chosen)] = chosen
            for name in SENT:
                record["motor"][name][: len(chosen)] = targets[name]
            written.append(encode_command(record).hex())
    served, shown = Served(robot), []

    def out(topic: str, kind: Any) -> Callable[[bytes], None]:
        return lambda data: shown.append([topic, data.hex()])

    quiet = SimpleNamespace(reader=lambda *words, **options: (), out=out, close=lambda: None)
    with (
        served.still(),
        mock.patch.object(servers, "InterfaceNode", return_value=quiet),
        mock.patch.object(servers, "SwitcherServer"),
        mock.patch.object(servers, "ServedHand", return_value=SimpleNamespace(there=False)),
    ):
        served.show(servers.UnitreeServer(served.driver, "lo"))
    return written, shown


# NAOqi: calls to ALMotion, and what ALMemory and ALMotion answer.


def naoqi() -> tuple[Said, Said]:
    from tci.wires.naoqi import services
    from tci.wires.naoqi.board import Board
    from tci.wires.naoqi.stream import Stream

    robot, written = robot_of("nao"), []
    limits = [servo.limits for servo in robot.servos]
    lower, upper, fastest = np.array([[one.lower, one.upper, one.velocity] for one in limits], dtype=float).T

    class Motion:
        def setAngles(self, *words: Any, _async: bool) -> Any:
            written.append(["setAngles", *plain(words)])
            return SimpleNamespace(isFinished=lambda: True, hasError=lambda: False)

    stream = Stream([servo.name for servo in robot.servos], lower, upper, fastest)
    measured = np.array(initial_position(robot))
    for safe in commands(robot, [Mode.POSITION, Mode.POSITION]):
        stream.send(Motion(), safe, safe.position + 0.002, measured)
    served = Served(robot)
    board = Board(robot, served.reading)
    shown: Said = []
    for sent in served.sent:
        board.store_skin(served.reading)
        board.store(served.reading, sent)
        motion = services.ALMotion(board)
        answers = {key: value() for key, value in sorted(board.keys().items())}
        shown.append([motion.getAngles("Body", True), motion.getStiffnesses("Body"), plain(answers)])
    return written, shown


# YARP: bottles as bytes, by port.


def yarp(name: str) -> tuple[Said, Said]:
    from tci.wires.yarp import board_driver, server
    from yarpwire.board import BoardV3, BoardV4
    from yarpwire.bottle import encode_bottle, encode_vector
    from yarpwire.dialect import V3, V4
    from yarpwire.state import encode_state

    dialect, kind = (V3, BoardV3) if name == "yarp" else (V4, BoardV4)
    robot, written = robot_of("icub"), []
    servos = robot.servos_of("left_arm")

    def put(port: str, value: Any) -> None:
        data = (
            b"".join(encode_vector(value, dialect))
            if isinstance(value, np.ndarray)
            else encode_bottle(value, dialect)
        )
        written.append([port, data.hex()])

    class Caller:
        def call(self, *items: Any, patience: float = 0.0) -> list[Any]:
            return []

        def send_call(self, *items: Any) -> None:
            put("rpc", list(items))

        def close(self) -> None:
            return

    class Kept(kind):  # type: ignore[misc, valid-type]
        def axes(self) -> int:
            return len(servos)

        def name(self, joint: int) -> str:
            return servos[joint].name

        def impedance(self, joint: int) -> tuple[float, float]:
            return 0.5, 0.05

        def call(self, call: Sequence[Any]) -> Sequence[Any]:
            put("rpc", list(call))
            return []

        def settle(self, patience: float = 0.0) -> bool:
            return True

    network = SimpleNamespace(
        caller=lambda *words: Caller(),
        writer=lambda target, sender: SimpleNamespace(
            offer=lambda value, dialect: put(target, value), close=lambda: None
        ),
    )
    here = reading(robot).joints
    state = server.ServedBoard("left_arm", servos)
    state.update(here, (Mode.POSITION,) * len(robot.servos))
    latest = SimpleNamespace(value=state.state, stamp=NOW, sequence=1)
    with (
        mock.patch.object(
            board_driver, "find_board", lambda n, prefix, own, d: Kept(prefix, network, None, own)
        ),
        mock.patch.object(board_driver, "Feed", return_value=SimpleNamespace(latest=latest)),
    ):
        board = board_driver.BoardDriver(
            "/icub/left_arm", servos, network, own="/tci", carrier="fast_tcp", dialect=dialect
        )
    for safe in commands(robot, [Mode.POSITION, Mode.IMPEDANCE, Mode.VELOCITY, Mode.TORQUE]):
        board.send(safe, safe.position + 0.002)
    board.halt()
    shown: Said = []
    for part in sorted({servo.robot_part for servo in robot.servos}):
        one = server.ServedBoard(part, robot.servos_of(part))
        one.update(here, (Mode.POSITION,) * len(robot.servos))
        position = b"".join(encode_vector(np.asarray(one.state.position), dialect))
        shown.append([part, position.hex(), encode_bottle(encode_state(one.state, dialect), dialect).hex()])
    contacts = Served(robot).perception.contacts
    shown.append(["skin_events", encode_bottle(server.EventForm(robot).encode(contacts), dialect).hex()])
    return written, shown


WIRES: dict[str, Callable[[], tuple[Said, Said]]] = {
    "zenoh": lambda: remote(cdr),
    "lcm": lcm,
    "ros": ros,
    "player": player,
    "unitree": unitree,
    "naoqi": naoqi,
    "yarp": lambda: yarp("yarp"),
    "yarp4": lambda: yarp("yarp4"),
}
"""What the driver writes and what the server shows, by wire."""


def said(name: str) -> dict[str, Said]:
    written, shown = WIRES[name]()
    return {"driver": plain(written), "server": plain(shown)}


def main() -> None:
    for name in WIRES if sys.argv[1:] == ["all"] else sys.argv[1:]:
        lines = [
            f' "{side}": [\n  ' + ",\n  ".join(json.dumps(one) for one in messages) + "\n ]"
            for side, messages in said(name).items()
        ]
        (FOLDER / f"{name}.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


if __name__ == "__main__":
    main()
