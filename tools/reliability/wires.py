"""Sends mutated frames to each receiver of TCI. Each receiver runs in a separate process."""

from __future__ import annotations

import itertools
import json
import random
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

import psutil
from pool import Result, gather
from row import Row

from helpers.hostile_bottles import strange_messages
from helpers.mutated import mutated
from helpers.player_exchange import said
from helpers.remote_messages import NAO, READ, WHOLE
from helpers.yarp_captures import DIALECTS, binary
from tci.errors import DriverError, FrameError
from tci.recording.rosmsg.cdr import MessageType, decode, encode
from tci.recording.schemas import CLOUD, JOINTS, SKIN, joints_values, skin_values
from tci.robot.kinematics import KinematicChain
from tci.runtime.heartbeat import decode as to_beat
from tci.runtime.heartbeat import encode as beat
from tci.shared.ros_node import Callback, Publish, RosNode
from tci.shared.ros_trees import Trees
from tci.skin.surfaces import build_surface
from tci.wires.lcm.datagrams import Datagrams
from tci.wires.naoqi import words
from tci.wires.player import wire
from tci.wires.player.wire import Stream
from tci.wires.ros.cloud import PatchCloud
from tci.wires.ros.names import Names
from tci.wires.ros.native import NativeRobot
from yarpwire import message
from yarpwire.bottle import decode_bottle, decode_vector
from yarpwire.dialect import V3
from yarpwire.errors import WireError
from yarpwire.name_server import NameServer
from yarpwire.names import Names as YarpNames
from yarpwire.port import Port
from yarpwire.source import Memory

JOB = 50_000
"""Number of frames of one job at full size."""
MEMORY = 50e6
"""Largest accepted growth [bytes] of a process's memory."""
Receiver = Callable[[random.Random], bool]
"""Function that receives one mutated frame; True if it was accepted although the protocol has a checksum."""


def remote() -> Receiver:
    """Messages between TCI processes, over Zenoh, ROS, rosbridge and Player, with a checksum."""

    def take(chance: random.Random) -> bool:
        kind = chance.choice("SFO")
        bad = mutated(WHOLE[kind], chance)
        try:
            READ[kind](NAO, bad)
        except FrameError:
            return False
        return bad != WHOLE[kind]

    return take


def lcm() -> Receiver:
    """Datagrams of LCM, whole and in fragments, and messages in them with a checksum."""
    from helpers.lcm_messages import WHOLE as MESSAGES
    from helpers.lcm_messages import pieces, short

    datagrams, numbers = Datagrams(), itertools.count()

    def take(chance: random.Random) -> bool:
        read, _, good = chance.choice(MESSAGES)
        number = next(numbers) % 2**32
        sent = [short(number, b"c", good)] if chance.random() < 0.5 else pieces(number, good, 3)
        sent[chance.randrange(len(sent))] = mutated(chance.choice(sent), chance)
        wrong = False
        for data in sent:
            if (whole := datagrams.take(data, number)) is not None:
                with suppress(FrameError):
                    read(NAO, whole[1])
                    wrong |= whole[1] != good
        return wrong

    return take


def yarp() -> Receiver:
    """Bottles, Vectors and messages of both dialects, without a checksum; and valid messages with impossible
    requests to a served board, to a port and to a driver."""
    messages = [
        (data, dialect) for name, dialect in DIALECTS.items() for one in binary(name) for way, data in one
        if way == ">" and len(data) > 30
    ]  # fmt: skip
    strange = strange_messages(Port("/tci/mutated", YarpNames(NameServer().address), V3))

    def take(chance: random.Random) -> bool:
        if chance.random() < 0.5:
            strange(chance)
            return False
        data, dialect = chance.choice(messages)
        for read in (decode_bottle, decode_vector):
            with suppress(WireError):
                blocks = message.read_message(Memory(mutated(data, chance)))
                read(message.unpack_command(b"".join(blocks))[1], dialect)
        return False

    return take


def player() -> Receiver:
    """Recorded messages of the genuine Player program as client and as server, without a checksum."""
    good = [data for _, _, data in said("client") + said("server") if not data.startswith(b"Player v.")]
    decoders = (wire.to_floats, wire.to_blob, wire.to_actuators, wire.to_devices, wire.to_access)

    def take(chance: random.Random) -> bool:
        with suppress(FrameError):
            for one in Stream().feed(mutated(chance.choice(good), chance)):
                for read in decoders:
                    with suppress(FrameError):
                        read(one.body)
        return False

    return take


def naoqi() -> Receiver:
    """Skin frames as text in NAOqi's ALMemory, without a checksum."""
    good = words.pack(7, READ["F"](NAO, WHOLE["F"]).frame.values).encode()

    def take(chance: random.Random) -> bool:
        with suppress(FrameError):
            words.unpack(mutated(good, chance).decode("latin-1"), 240)
        return False

    return take


def ros() -> Receiver:
    """Messages of a robot's own ROS 2 topics as CDR, without a checksum."""
    node, kinds = _Wires(), _ros_messages()

    def take(chance: random.Random) -> bool:
        kind, values = chance.choice(kinds)
        node.arrive(kind, mutated(encode(kind, values), chance), chance)
        return False

    return take


def rosbridge() -> Receiver:
    """Messages of a robot's own ROS topics as JSON, in the form of rosbridge, without a checksum."""
    node = _Wires()
    trees = Trees(lambda _, fields: dict(fields), lambda found, name: found[name], ("sec", "nanosec"))
    texts = [
        (kind, json.dumps(trees.grow(kind, values), default=list).encode())
        for kind, values in _ros_messages()
    ]

    def take(chance: random.Random) -> bool:
        kind, text = chance.choice(texts)
        with suppress(ValueError):  # roslibpy parses the JSON
            tree = json.loads(mutated(text, chance))
            node.arrive(kind, lambda: trees.flatten(kind, tree), chance)
        return False

    return take


def heartbeat() -> Receiver:
    """Heartbeats between processes, with a checksum."""
    good = beat("brain", 7)

    def take(chance: random.Random) -> bool:
        bad = mutated(good, chance)
        return bad != good and to_beat(bad) is not None

    return take


RECEIVERS = {one.__name__: one for one in (remote, lcm, yarp, player, naoqi, ros, rosbridge, heartbeat)}


def wires(full: bool) -> Row:
    """Tests all receivers. The number of trials of the row is that of the receiver with the fewest frames."""
    jobs = [(name, seed, JOB if full else 2_000) for seed in range(20 if full else 1) for name in RECEIVERS]
    done = gather("wires", _receive, jobs, full=full)
    tried = {name: sum(one["tried"] for one in done if one["name"] == name) for name in RECEIVERS}
    wrong, grown = sum(one["wrong"] for one in done), max((one["grown"] for one in done), default=0.0)
    crashed = [one["crash"] for one in done if one["crash"]]
    for words_ in crashed:
        print(words_)
    return Row(
        f"damaged messages to each of {len(RECEIVERS)} receivers",
        min(tried.values()),
        1e6,
        "messages to each receiver",
        f"{len(crashed)} crashes; {wrong} damaged messages accepted although the protocol has a checksum; "
        f"largest growth of memory {grown / 1e6:.0f} MB",
        "0 crashes, 0 damaged messages accepted, growth < 50 MB",
        not crashed and not wrong and grown < MEMORY,
    )


def _ros_messages() -> list[tuple[MessageType, Sequence[Any]]]:
    joints, frame = READ["S"](NAO, WHOLE["S"]).joints, READ["F"](NAO, WHOLE["F"]).frame
    names, surface = Names(NAO, "ros2", ""), build_surface(NAO, NAO.patch(frame.patch), KinematicChain(NAO))
    return [
        (JOINTS, joints_values([names.joint(servo) for servo in NAO.servos], joints, 3.5)),
        (SKIN, skin_values(frame, 0, 3.5)),
        (CLOUD, PatchCloud(NAO.patch(frame.patch), surface).values(frame, 3.5)),
    ]


def _receive(name: str, seed: int, count: int) -> Result:
    chance, receive = random.Random(f"{name} {seed}"), RECEIVERS[name]()
    tried = wrong = 0
    crash, before = "", 0
    for number in range(count):
        if number == count // 10:  # all modules are loaded at this point
            before = psutil.Process().memory_info().rss
        try:
            wrong += receive(chance)
        except Exception as error:
            crash = f"{name}, seed {seed}, frame {number}: {type(error).__name__}: {error}"
            break
        tried += 1
    grown = psutil.Process().memory_info().rss - before
    return {"name": name, "tried": tried, "wrong": wrong, "grown": float(grown), "crash": crash}


class _Wires(RosNode):
    """A ROS node whose topics exist only in this process, and a robot on these topics."""

    def __init__(self) -> None:
        super().__init__()
        self._callbacks: dict[str, list[Callback]] = {}
        now = itertools.count()
        self.robot = NativeRobot(
            NAO, self, Names(NAO, "ros2", ""), arm=False, period=0.01, now=lambda: next(now) * 1e-3
        )

    def arrive(
        self, kind: MessageType, data: bytes | Callable[[], dict[str, Any]], chance: random.Random
    ) -> None:
        """Delivers one message on a random topic of its type."""
        read = (lambda: decode(kind, data)) if isinstance(data, bytes) else data
        self._pass_on("topic", read, chance.choice(self._callbacks[kind.name]))
        with suppress(DriverError):
            joints = self.robot.reading().joints
            assert joints.position.shape == joints.velocity.shape == (len(NAO.servos),)

    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        self._callbacks.setdefault(kind.name, []).append(callback)

    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        raise NotImplementedError

    def types_of(self, topic: str) -> tuple[str, ...]:
        return ()

    def close(self) -> None:
        pass
