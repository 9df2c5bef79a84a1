"""The client of a control board, which is the YARP device that controls the joints of a robot part.

Calls differ between the two dialects, YARP 3.x and 4.x. The commands that are streamed to the port
`command:i` differ only in the words that name the commanded quantity. Angles are in degrees.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from yarpwire.dialect import V3, V4, Dialect
from yarpwire.errors import PortError, UnknownNameError
from yarpwire.names import PATIENCE, Contact
from yarpwire.network import Network
from yarpwire.values import Array, Int16, Vocab

IDLE, FORCE_IDLE, MIXED = Vocab("idl"), Vocab("fidl"), Vocab("mix")
POSITION, DIRECT = Vocab("pos"), Vocab("posd")
VELOCITY, VELOCITY_DIRECT, TORQUE = Vocab("vel"), Vocab("veld"), Vocab("torq")
STIFF, COMPLIANT = Vocab("stif"), Vocab("comp")
OK = Vocab("ok")


class Stream(Enum):
    """The quantity that a streamed command sets."""

    POSITION = ("ipod", "dpog")
    """Target angles [deg], for position-direct mode."""
    VELOCITY = ("ivel", "vmog")
    """Velocities [deg/s]."""
    TORQUE = ("itrq", "dtqg")
    """Torques [N m]."""


MOST_AXES = 256
"""Largest number of axes of a board. Assumed: robots have far fewer axes. The client calls the board once per
axis to get its name, so the bound limits the number of calls."""


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Smallest and largest angle that a board permits for a joint."""

    lower: float
    """Smallest angle [deg]."""
    upper: float
    """Largest angle [deg]."""


def find_board(network: Network, prefix: str, sender: str, dialect: Dialect | None = None) -> Board:
    """Returns the board with port names that begin with `prefix`. If `dialect` is None, the name of the
    board's call port determines the dialect.

    Raises UnknownNameError if no board has this prefix, and PortError if the name server does not answer.
    """
    there = {contact.name: contact for contact in network.list()}
    found = [
        (kind, there[prefix + kind.port])
        for kind in (BoardV3, BoardV4)
        if prefix + kind.port in there and dialect in (None, kind.dialect)
    ]
    # A board of the other dialect may have crashed without unregistering its name.
    for kind, contact in found:
        if contact is found[-1][1] or contact.answers():
            return kind(prefix, network, contact, sender)
    boards = [
        name.removesuffix(port)
        for name in there
        for port in (BoardV4.port, BoardV3.port)
        if name.endswith(port)
    ]
    spoken = f" of YARP {dialect.name}" if dialect is not None else ""
    raise UnknownNameError(f"control board{spoken}", prefix, sorted(set(boards)))


class Board(ABC):
    """Calls to one control board. Every call raises PortError if the board does not answer or refuses."""

    dialect: Dialect
    port: str
    """Last part of the name of the call port, after the prefix."""

    def __init__(self, prefix: str, network: Network, contact: Contact, sender: str) -> None:
        self.prefix = prefix
        """Common beginning of the names of the board's ports, for example `/icub/left_arm`."""
        self._rpc = network.caller(contact, sender, self.dialect)
        self._open_calls: deque[tuple[Sequence[Any], float]] = deque()
        self._refusal: PortError | None = None

    def close(self) -> None:
        """Closes the connection."""
        self._rpc.close()

    @abstractmethod
    def axes(self) -> int:
        """Returns the number of joints."""

    @abstractmethod
    def name(self, joint: int) -> str:
        """Returns the name that the board gives to a joint."""

    @abstractmethod
    def limits(self, joint: int) -> AxisLimits:
        """Returns the range of a joint."""

    @abstractmethod
    def impedance(self, joint: int) -> tuple[float, float]:
        """Returns stiffness [N m/deg] and damping [N m s/deg] of a joint in compliant mode."""

    @abstractmethod
    def modes_call(self, joints: Sequence[int], mode: Vocab) -> list[Any]:
        """Returns the call that switches joints to a control mode."""

    @abstractmethod
    def interaction_call(self, joint: int, mode: Vocab) -> list[Any]:
        """Returns the call that makes a joint stiff or compliant."""

    @abstractmethod
    def check(self, call: Sequence[Any], answer: Sequence[Any]) -> Sequence[Any]:
        """Returns the data in an answer. Raises PortError if the board refuses the call."""

    def set_modes(self, joints: Sequence[int], mode: Vocab) -> None:
        """Switches joints to a control mode."""
        self.call(self.modes_call(joints, mode))

    def set_interaction(self, joint: int, mode: Vocab) -> None:
        """Makes a joint stiff or compliant."""
        self.call(self.interaction_call(joint, mode))

    def call(self, call: Sequence[Any]) -> Sequence[Any]:
        """Makes a call and returns the data in the answer."""
        return self.check(call, self._rpc.call(*call))

    def send_call(self, call: Sequence[Any]) -> None:
        """Makes a call without waiting for the answer; `settle` reads the answer later."""
        self._rpc.send_call(*call)
        self._open_calls.append((call, time.monotonic()))

    def settle(self, patience: float = 0.0) -> bool:
        """Returns True if all calls of `send_call` are answered. Waits at most `patience` [s] for each
        answer. Raises PortError if the board refused a call, or did not answer within 2 s after the call."""
        while self._open_calls:
            call, since = self._open_calls[0]
            if not self._rpc.is_answered(patience) and time.monotonic() - since < PATIENCE:
                return False
            self._open_calls.popleft()
            try:
                answer = self._rpc.read_reply()
            except PortError:
                self._open_calls.clear()
                raise
            try:
                self.check(call, answer)
            except PortError as error:
                self._refusal = error
        refusal, self._refusal = self._refusal, None
        if refusal is not None:
            raise refusal
        return True

    @abstractmethod
    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        """Sets stiffness [N m/deg] and damping [N m s/deg] of a joint."""

    @abstractmethod
    def stop(self) -> None:
        """Stops all joints at their present angles, regardless of their commands."""

    @abstractmethod
    def head(self, stream: Stream, joints: Sequence[int]) -> list[Any]:
        """Returns the head of a streamed command: the quantity, and the joints that the command affects."""

    def command(self, stream: Stream, joints: Sequence[int], values: Array) -> list[Any]:
        """Returns a streamed command: the head, and the values (k,) of the joints."""
        return [self.head(stream, joints), values]

    def _count(self, found: Sequence[Any], what: str) -> int:
        if len(found) != 1 or not isinstance(found[0], int) or not 0 < found[0] <= MOST_AXES:
            raise PortError(
                f"{self.prefix} answers {str(found)[:80]} to {what}; valid: 1 to {MOST_AXES} axes"
            )
        return found[0]

    def _numbers(self, found: Sequence[Any], count: int, what: Sequence[Any]) -> list[float]:
        if len(found) != count or not all(isinstance(value, int | float) for value in found):
            raise PortError(f"{self.prefix} answers {str(found)[:80]} to {what}; valid: {count} numbers")
        return [float(value) for value in found]


class BoardV3(Board):
    """Control board of YARP 3.12.

    Calls consist of vocabularies (words of up to four letters), such as `[get] [llim] 3` for the lower limit
    of joint 3. The answer to this call is `[is] [llim] x [tsta] n t [ok]`, with the limit x, the sequence
    number n and the time t [s]. The answer is `[fail]` if the call failed, and `[nak]` if the board does not
    know the call.
    """

    dialect = V3
    port = "/rpc:i"

    def axes(self) -> int:
        return self._count(self._get("axes"), "axes")

    def name(self, joint: int) -> str:
        return " ".join(str(item) for item in self._get("name", joint))

    def limits(self, joint: int) -> AxisLimits:
        return AxisLimits(*self._numbers(self._get("llim", joint), 2, ("llim", joint)))

    def impedance(self, joint: int) -> tuple[float, float]:
        found = self._get("iimp", "ipr", joint)
        pair = found[0] if len(found) == 1 and isinstance(found[0], list) else found
        stiffness, damping = self._numbers(pair, 2, ("iimp", "ipr", joint))
        return stiffness, damping

    def modes_call(self, joints: Sequence[int], mode: Vocab) -> list[Any]:
        return _words("set", "icmd", "cmog", len(joints), list(joints), [mode] * len(joints))

    def interaction_call(self, joint: int, mode: Vocab) -> list[Any]:
        return _words("set", "intm", "mode", joint, mode)

    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        self._set("iimp", "ipr", joint, [float(stiffness), float(damping)])

    def stop(self) -> None:
        self._set("stos")

    def head(self, stream: Stream, joints: Sequence[int]) -> list[Any]:
        return [Vocab(stream.value[1]), len(joints), list(joints)]

    def _get(self, *words: Any) -> list[Any]:
        """Asks the control board for a value, by the call `[get]` with the arguments `words`. Returns the
        data in the answer, without vocabularies and time."""
        answer = self.call(_words("get", *words))
        if answer[0] != Vocab("is") or len(answer) < 6 or answer[-4] != Vocab("tsta"):
            raise PortError(
                f"{self.prefix} answers {str(answer)[:80]} to {words}; valid: [is] ... [tsta] n t [ok]"
            )
        return list(answer[2:-4])

    def _set(self, *words: Any) -> None:
        self.call(_words("set", *words))

    def check(self, call: Sequence[Any], answer: Sequence[Any]) -> Sequence[Any]:
        if not answer or answer[-1] != OK:
            raise PortError(f"{self.prefix} refuses {call}: {answer or 'no answer'}")
        return answer


def _words(*items: Any) -> list[Any]:
    return [Vocab(item) if isinstance(item, str) else item for item in items]


class BoardV4(Board):
    """Control board of YARP 4.0. A call begins with the name of a method. The answer is `([ok]) data` or
    `[ok]`. The answer to a failed call has another vocabulary in place of `[ok]`."""

    dialect = V4
    port = "/nws/rpc:i"

    def axes(self) -> int:
        return self._count(self._call("getAxesRPC"), "getAxesRPC")

    def name(self, joint: int) -> str:
        return " ".join(str(item) for item in self._call("getAxisNameRPC", joint))

    def limits(self, joint: int) -> AxisLimits:
        found = self._call("getPosLimitsRPC", Int16(joint))
        return AxisLimits(*self._numbers(found, 2, ("getPosLimitsRPC", joint)))

    def impedance(self, joint: int) -> tuple[float, float]:
        found = self._call("getImpedanceRPC", joint)
        stiffness, damping = self._numbers(found, 2, ("getImpedanceRPC", joint))
        return stiffness, damping

    def modes_call(self, joints: Sequence[int], mode: Vocab) -> list[Any]:
        return ["setControlModeGroupRPC", list(joints), [int(mode)] * len(joints)]

    def interaction_call(self, joint: int, mode: Vocab) -> list[Any]:
        return ["setInteractionModeOneRPC", joint, int(mode)]

    def set_impedance(self, joint: int, stiffness: float, damping: float) -> None:
        self._call("setImpedanceRPC", joint, float(stiffness), float(damping))

    def stop(self) -> None:
        self._call("stopAllRPC")

    def head(self, stream: Stream, joints: Sequence[int]) -> list[Any]:
        interface, word = stream.value
        return [Vocab(interface), Vocab(word), len(joints), list(joints)]

    def _call(self, *call: Any) -> list[Any]:
        return list(self.call(call))

    def check(self, call: Sequence[Any], answer: Sequence[Any]) -> Sequence[Any]:
        head = answer[0] if answer else None
        if head != OK and head != [OK]:
            raise PortError(f"{self.prefix} refuses {call[0]} {call[1:]}: {answer or 'no answer'}")
        return answer[1:]
