"""One participant in a DDS domain on one network interface, as Unitree's robots use it.

No Python thread receives messages. Cyclone keeps the newest messages until they are read.
"""

from __future__ import annotations

from typing import Any

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tci.errors import DriverError
from tci.shared.dds_domain import MOST_PARTICIPANTS, close_domain, open_domain
from tci.shared.interfaces import is_loopback
from tci.shared.own_sockets import on_interface

RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=0))
"""DDS policy by which a writer sends lost messages again, but never waits for a slow reader."""
MOST = 16
"""Number of messages of a topic that are stored until TCI reads the topic, if TCI needs more than the newest
message. Assumed: a robot gets a few calls per second, and sends 8 states in a period of 60 Hz."""


class Out:
    """Sends messages of one topic as bytes."""

    def __init__(self, writer: DataWriter[Any], kind: type[IdlStruct]) -> None:
        self._writer = writer
        self._sample: Any = kind.__new__(kind)

    def __call__(self, data: bytes) -> None:
        """Sends one message. A reader that is too slow misses the message. Raises DriverError if the message
        can't be sent."""
        self._sample.raw = data
        try:
            self._writer.write(self._sample)
        except DDSException as error:
            if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                raise DriverError(f"a message can't be sent: {error}") from error


class InterfaceNode:
    """One DDS participant, which sends and receives only on one network interface."""

    def __init__(self, interface: str, domain: int) -> None:
        """Joins the DDS domain on an interface. Raises DriverError if the domain can't be opened."""
        self._domain = domain
        with on_interface(interface):
            open_domain(domain, _settings(interface), f"Unitree on {interface}")
            self._participant: DomainParticipant | None = DomainParticipant(domain)
        self._publications = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication)
        self._writers: dict[Any, tuple[str, Any]] = {}

    def out(self, topic: str, kind: type[IdlStruct]) -> Out:
        """Returns a function that sends bytes as a message of `topic`."""
        return Out(self.writer(topic, kind), kind)

    def writer(self, topic: str, kind: type[IdlStruct], keep: int = 1) -> DataWriter[Any]:
        """Returns a writer of messages. The writer sends a lost message again while the message is among the
        last `keep` messages."""
        qos = Qos(RELIABLE, Policy.History.KeepLast(keep))
        return DataWriter(self._there(), Topic(self._there(), topic, kind), qos=qos)

    def reader(
        self,
        topic: str,
        kind: type[IdlStruct],
        *,
        keep: int = 1,
        reliable: bool = False,
        foreign: bool = False,
    ) -> DataReader[Any]:
        """Returns a reader of a topic, which keeps the newest `keep` messages.

        With `reliable`, the sender is asked to send lost messages again. With `foreign`, messages of this
        participant are not received.
        """
        kept: list[Any] = [Policy.IgnoreLocal.Participant] if foreign else []
        kept += [RELIABLE if reliable else Policy.Reliability.BestEffort, Policy.History.KeepLast(keep)]
        return DataReader(self._there(), Topic(self._there(), topic, kind), qos=Qos(*kept))

    def other_writers(self, topic: str) -> int:
        """Returns the number of other programs that may write a topic.

        This program and the robot's own programs, which also write rt/lowstate, do not count.
        """
        for sample in self._publications.take(1000):
            if sample.sample_info.valid_data:
                self._writers[sample.key] = sample.topic_name, sample.participant_key
            else:
                self._writers.pop(sample.key, None)
        writers: dict[str, set[Any]] = {topic: set(), "rt/lowstate": {self._there().guid}}
        for name, participant in [*self._writers.values()]:  # a fade may ask too
            if name in writers:
                writers[name].add(participant)
        return len(writers[topic] - writers["rt/lowstate"])

    def fault_of_writers(self, topic: str, *, heard: bool = False) -> str:
        """Why nothing may be written to a topic of commands; empty if no other program writes it. Commands
        that were `heard` are another's, whatever discovery says."""
        other = heard or self.other_writers(topic)
        return f"another program writes {topic}; valid: only one" if other else ""

    def close(self) -> None:
        """Leaves the domain. A second call has no effect."""
        if self._participant is not None:
            # deletes all DDS entities of the participant, also if other objects refer to the entities
            self._participant.__del__()
            self._participant = None
            del self._publications
            close_domain(self._domain)

    def _there(self) -> DomainParticipant:
        if self._participant is None:
            raise DriverError("this connection to a Unitree robot is closed")
        return self._participant


def latest(reader: DataReader[Any], most: int = MOST) -> list[Any]:
    """Returns the messages that have arrived since the last call, at most `most`, the oldest first."""
    return [sample for sample in reader.take(most) if isinstance(sample, IdlStruct)]


def _settings(interface: str) -> str:
    """Returns the settings of Cyclone DDS for one network interface. Multicast is off on loopback, which has
    none."""
    here = is_loopback(interface)
    network = (
        f'<NetworkInterface name="{interface}"{" multicast=" + chr(34) + "false" + chr(34) if here else ""}/>'
    )
    general = f"<General><Interfaces>{network}</Interfaces>"
    general += "<AllowMulticast>false</AllowMulticast></General>" if here else "</General>"
    found = "<Discovery><ParticipantIndex>auto</ParticipantIndex>"
    found += f"<MaxAutoParticipantIndex>{MOST_PARTICIPANTS}</MaxAutoParticipantIndex>"
    found += '<Peers><Peer address="127.0.0.1"/></Peers>' if here else ""
    return f'<CycloneDDS><Domain Id="any">{general}{found}</Discovery></Domain></CycloneDDS>'
