"""A ROS 2 node on cyclonedds, for machines without ROS 2. For other nodes, this node looks like a node of ROS
2.

No Python thread receives messages. Cyclone keeps the newest messages until the loop polls. The node follows
these environment variables of ROS 2: ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE, ROS_STATIC_PEERS and
CYCLONEDDS_URI.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Sequence
from functools import cache, partial
from ipaddress import IPv4Address
from typing import Any
from xml.sax.saxutils import quoteattr

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tci.drivers.remote.hosts import numeric
from tci.errors import DriverError
from tci.recording.rosmsg.cdr import HEADER, MessageType, decode, encode, item_of
from tci.shared.dds_domain import MOST_PARTICIPANTS, close_domain, open_domain
from tci.shared.dds_types import carry_raw
from tci.shared.ros_node import LIFESPAN, Callback, Publish, RosNode

RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=0))
"""Policy that repeats lost messages, but never waits for a slow reader."""
FRESH = Policy.Lifespan(duration(seconds=LIFESPAN))
"""Policy that deletes messages older than LIFESPAN. Without this policy, Cyclone would store messages that a
dead reader did not acknowledge, and would send them to later readers."""
GRAPH = MessageType(
    "rmw_dds_common/msg/ParticipantEntitiesInfo",
    (("rmw_dds_common/Gid", "gid"), ("rmw_dds_common/NodeEntitiesInfo[]", "nodes")),
    needs=(
        ("rmw_dds_common/Gid", (("uint8[16]", "data"),)),
        (
            "rmw_dds_common/NodeEntitiesInfo",
            (
                ("string", "node_namespace"),
                ("string", "node_name"),
                ("rmw_dds_common/Gid[]", "readers"),
                ("rmw_dds_common/Gid[]", "writers"),
            ),
        ),
    ),
    headed=False,
)
"""Message that says to which ROS node each topic of a DDS participant belongs. `ros2 node list` needs this
message."""
# `uint8` is declared as byte, because cyclonedds 11 announces `uint8` as TK_UINT8, and programs on Cyclone
# 0.10 (the version in ROS 2) then crash.
SIMPLE = {
    "bool": bool, "int8": types.int8, "uint8": types.byte, "int16": types.int16, "uint16": types.uint16,
    "int32": types.int32, "uint32": types.uint32, "int64": types.int64, "uint64": types.uint64,
    "float32": types.float32, "float64": types.float64, "string": str,
}  # fmt: skip
_TIME = ("builtin_interfaces/Time", (("int32", "sec"), ("uint32", "nanosec")))
_HEADER = ("std_msgs/Header", (("builtin_interfaces/Time", "stamp"), HEADER[2]))


class DdsNode(RosNode):
    """A node on cyclonedds that looks like a node of ROS 2 to other nodes."""

    def __init__(self, name: str, namespace: str = "", *, reach: str = "LOCALHOST") -> None:
        """Opens the node. `reach` is the range in which nodes discover each other, a value of
        ROS_AUTOMATIC_DISCOVERY_RANGE. Raises DriverError if an environment variable has a value that is
        invalid or that Cyclone refuses.
        """
        super().__init__()
        self._id = _domain_id()
        _open_domain(self._id, reach)
        self._name, self._namespace = name, namespace or "/"
        self._publishers: list[_Publisher] = []
        self._readers: list[tuple[str, MessageType, DataReader[Any], Callback, int]] = []
        self._participant: DomainParticipant | None = DomainParticipant(
            self._id, qos=Qos(Policy.Userdata(b"enclave=/;"))
        )
        self._graph = _Publisher(self._writer("ros_discovery_info", GRAPH, latched=True), GRAPH)
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._seen: dict[Any, tuple[str, str]] = {}
        self._announce()

    def advertise(self, topic: str, kind: MessageType, *, latched: bool = False) -> Publish:
        writer = self._writer(f"rt{topic}", kind, latched=latched)
        self._publishers.append(_Publisher(writer, kind))
        self._announce()
        return self._publishers[-1]

    def subscribe(
        self, topic: str, kind: MessageType, callback: Callback, *, latched: bool = False, keep: int = 1
    ) -> None:
        policies = [
            RELIABLE if latched else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(keep),
        ]
        reader = DataReader(self._opened(), self._topic(f"rt{topic}", kind), qos=_qos(policies, kind))
        self._readers.append((topic, kind, reader, callback, keep))
        self._announce()

    def poll(self) -> None:
        for topic, kind, reader, callback, keep in self._readers:
            for sample in reader.take(keep):
                if isinstance(sample, IdlStruct):  # any other sample means that a writer has disconnected
                    self._pass_on(topic, partial(decode, kind, sample.raw), callback)  # type: ignore[attr-defined] # set by _idl

    def types_of(self, topic: str) -> tuple[str, ...]:
        return self.topics().get(topic, ())

    def topics(self) -> dict[str, tuple[str, ...]]:
        for sample in self._publications.take(1000):
            if sample.sample_info.valid_data:
                self._seen[sample.key] = sample.topic_name, sample.type_name
            else:
                self._seen.pop(sample.key, None)
        found: dict[str, set[str]] = {}
        for name, type_ in self._seen.values():
            if name.startswith("rt/"):
                plain = type_.replace("::dds_::", "::").replace("::", "/").rstrip("_")
                found.setdefault(name.removeprefix("rt"), set()).add(plain)
        return {name: tuple(sorted(kinds)) for name, kinds in sorted(found.items())}

    def close(self) -> None:
        if self._participant is None:
            return
        # deletes all DDS entities of the participant, also if other objects refer to the entities
        self._participant.__del__()
        self._participant = None
        self._readers.clear()
        for publisher in (*self._publishers, self._graph):
            publisher.writer = None
        del self._publications
        close_domain(self._id)

    def _writer(self, name: str, kind: MessageType, *, latched: bool) -> DataWriter[Any]:
        policies = [
            RELIABLE,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(1),
            *(() if latched else (FRESH,)),
        ]
        return DataWriter(self._opened(), self._topic(name, kind), qos=_qos(policies, kind))

    def _topic(self, name: str, kind: MessageType) -> Topic[Any]:
        return Topic(self._opened(), name, _idl(kind))

    def _opened(self) -> DomainParticipant:
        assert self._participant is not None
        return self._participant

    def _announce(self) -> None:
        gid = [list(self._opened().guid.bytes)]
        readers = [[list(reader.guid.bytes)] for _, _, reader, _, _ in self._readers]
        writers = [[list(found.writer.guid.bytes)] for found in self._publishers if found.writer is not None]
        self._graph((gid, [(self._namespace, self._name, readers, writers)]))


class _Publisher:
    """Publisher of one topic. A call with the values of a message's fields sends the message. Raises
    DriverError if the node is closed."""

    def __init__(self, writer: DataWriter[Any], kind: MessageType) -> None:
        self._kind, self._cls = kind, _idl(kind)
        self.writer: DataWriter[Any] | None = writer

    def __call__(self, values: Sequence[Any]) -> None:
        if self.writer is None:
            raise DriverError("this ROS 2 node is closed")
        sample: Any = self._cls.__new__(self._cls)
        sample.raw = encode(self._kind, values)
        try:
            self.writer.write(sample)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:  # a slow reader misses the message
                raise DriverError(f"{self._kind.name} can't be sent: {error}") from error


def _qos(policies: Sequence[Any], kind: MessageType) -> Qos:
    hashed = () if kind is GRAPH else (Policy.Userdata(f"typehash={type_hash(kind)};".encode()),)
    return Qos(*policies, *hashed, Policy.DataRepresentation(use_cdrv0_representation=True))


@cache
def type_hash(kind: MessageType) -> str:
    """Returns the RIHS01 hash by which ROS 2 distinguishes versions of a message type (REP 2011)."""
    store = get_typestore(Stores.ROS2_KILTED)
    if kind.name not in store.fielddefs:
        store.register(get_types_from_msg(kind.definition, kind.name))
    return str(store.hash_rihs01(kind.name))


@cache
def _idl(kind: MessageType) -> type[IdlStruct]:
    """Returns the DDS type for messages of `kind`. An object of this type has the encoded message as bytes in
    its attribute `raw`."""
    needs = dict(kind.needs)
    if kind.headed:
        needs |= dict((_TIME, _HEADER))
    fields = ((("std_msgs/Header", "header"),) if kind.headed else ()) + kind.fields
    return carry_raw(_struct(kind.name.replace("/msg/", "/"), fields, needs))


def _struct(
    name: str, fields: Sequence[tuple[str, str]], needs: dict[str, tuple[tuple[str, str], ...]]
) -> type[IdlStruct]:
    package, _, last = name.rpartition("/")
    package = package or "sensor_msgs"
    members: dict[str, Any] = {}
    for type_, field in fields:
        item, many = item_of(type_)
        inner: Any = SIMPLE.get(item)
        if inner is None:
            short = item.split("/")[-1]
            full = item if item in needs else next(key for key in needs if key.split("/")[-1] == short)
            inner = _struct(full, needs[full], needs)
        if many is not None:
            inner = types.array[inner, many] if many else types.sequence[inner]  # type: ignore[misc] # known only now
        members[f"{field}_"] = inner
    return make_idl_struct(f"{last}_", f"{package}::msg::dds_::{last}_", members)


def _domain_id() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdigit() and int(text) <= 232):
        raise DriverError(f"ROS_DOMAIN_ID is {text!r}; valid: 0 to 232")
    return int(text)


def _open_domain(number: int, reach: str) -> None:
    own = os.environ.get("CYCLONEDDS_URI")
    open_domain(number, f"{own},{_settings(reach)}" if own else _settings(reach), "ROS 2")


def _static_peers() -> list[str]:
    """Returns the machines in ROS_STATIC_PEERS as numeric addresses, with ports if given. Raises DriverError
    if an address is invalid.

    Names are resolved here because Cyclone DDS ends the process if it can't parse an address.
    """
    found = []
    for peer in filter(None, os.environ.get("ROS_STATIC_PEERS", "").split(";")):
        host, colon, port = peer.partition(":")
        try:
            found.append(f"{IPv4Address(numeric(host))}{colon}{port}")
            valid = not colon or 0 < int(port) < 1 << 16
        except ValueError:
            valid = False
        if not valid:
            raise DriverError(
                f"{peer!r} of ROS_STATIC_PEERS is no address; valid: HOST or HOST:PORT, "
                "where HOST is an IPv4 address or a name that has one"
            )
    return found


def _settings(reach: str) -> str:
    """Returns the settings with which Cyclone DDS discovers nodes as ROS 2 does. `reach` is a value of
    ROS_AUTOMATIC_DISCOVERY_RANGE.

    Cyclone DDS then ignores type information from Fast DDS, because the two interpret it differently.
    """
    peers = _static_peers()
    text = "<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>"
    if reach == "LOCALHOST":
        text += "<General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
        text += "<AllowMulticast>false</AllowMulticast></General>"
        peers.append("127.0.0.1")
    found = "".join(f"<Peer address={quoteattr(peer)}/>" for peer in peers)
    text += "<Discovery>"
    if reach == "OFF":
        text += f"<ParticipantIndex>none</ParticipantIndex><Tag>off_{secrets.token_hex(8)}</Tag>"
    elif reach != "SYSTEM_DEFAULT":
        text += "<ParticipantIndex>auto</ParticipantIndex>"
        text += f"<MaxAutoParticipantIndex>{MOST_PARTICIPANTS}</MaxAutoParticipantIndex>"
    text += (f"<Peers>{found}</Peers>" if found else "") + "</Discovery>"
    return f'<CycloneDDS><Domain id="any">{text}</Domain></CycloneDDS>'
