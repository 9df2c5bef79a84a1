"""Reasons for which something is refused, held or stopped: a code for programs, a text for people."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from enum import IntEnum, unique
from typing import Any

MOST = 100
"""Kinds of reasons that are kept. Assumed: more is no longer read."""
OTHERS = "other reasons"
"""Words that all further kinds are counted under."""


@unique
class Code(IntEnum):
    """Cause of a refusal, a hold, a stop or a fault.

    Wires and recordings carry the numbers: a new cause gets a new number, and none is ever used again.
    """

    OTHER = 0
    """A cause that only its text tells, such as one that an operator or a user's program gives."""

    JOINTS_STALE = 100
    """The joint data is too old, or says so."""
    JOINTS_MISFIT = 101
    """The joint data has another number of joints than the robot, or angles that are not finite."""
    JOINTS_REPEATED = 102
    """Identical joint data comes again under fresh stamps."""
    TIME_WENT_BACK = 103
    """The clock of the commands went back."""

    FOLLOWING_ERROR = 200
    """A servo does not follow its reference."""
    OPPOSED_MOTION = 201
    """A servo moves against its reference."""
    ENCODER_JUMPED = 202
    """An angle changed faster than the servo can move."""
    ENCODER_FROZEN = 203
    """An angle stands still while the servo must move."""
    ENCODER_DISAGREES = 204
    """An angle is elsewhere than its measured velocity leads."""
    SERVO_OFF = 205
    """A servo under command is switched off."""
    SERVO_MODE = 206
    """A servo reports another control mode than it is commanded in."""

    PERIODS_MISSED = 300
    """The loop missed periods."""
    PROCESS_FROZEN = 301
    """This process stood still for a while."""
    HEARTBEAT_MISSING = 302
    """A process that is needed is silent."""
    RUN_ENDED = 303
    """The run is over."""
    PROGRAM_FAILED = 304
    """The program raised an exception or was interrupted."""

    SKIN_SILENT = 400
    """A patch of skin sends nothing any more."""
    SKIN_MISFIT = 401
    """Frames of the skin do not fit the robot."""
    SKIN_BLIND = 402
    """Too few taxels can be trusted where the capability needs them."""

    COMMAND_INVALID = 500
    """A command has a type, shape or value that no robot accepts."""
    UNKNOWN_NAME = 501
    """A command names something that the robot does not have."""
    GATE_CLOSED = 502
    """The gate holds or has stopped, for a reason of its own."""
    WRONG_MODE = 503
    """A servo is in another control mode than the command, or does not have the mode that is asked for."""
    LIKELY_DEGREES = 504
    """Angles are so far off that they may be degrees."""
    LIMITS_UNKNOWN = 505
    """The description lacks limits without which a servo is not moved."""
    LIMITS_EXCEEDED = 506
    """A servo is measured too far outside its limits, or from its equilibrium, to be commanded."""
    IN_MOTION = 507
    """A servo would have to be at rest for this."""
    SELF_COLLISION = 508
    """Two links of the robot would come too near to each other."""
    OUT_OF_REACH = 509
    """No posture reaches the target."""
    NOT_ARMED = 510
    """The robot is shown read-only, or has not been read yet."""

    OTHER_COMMANDER = 600
    """Another process commands these joints."""
    COMMANDER_SILENT = 601
    """A process that commands the robot is silent."""
    COMMANDER_HOLDS = 602
    """The gate of a process that commands the robot holds."""
    COMMANDER_LEFT = 603
    """A process that commanded the robot has left."""
    OWNER_HOLDS = 604
    """The gate of the process that owns the robot holds."""
    OWNER_REFUSES = 605
    """The process that owns the robot refused an order."""
    OWNER_SILENT = 606
    """The process that owns the robot does not answer orders."""
    OWNER_RESTARTED = 607
    """The process that owns the robot was restarted."""
    HALTED = 608
    """The process that commands the robot called its own stop."""
    MOVED_BY_ITSELF = 609
    """The robot moves by itself, or something on it may move it."""
    ROBOT_REFUSES = 610
    """The robot's own controllers refuse, or can't be reached."""

    MOVED_WRONG_WAY = 700
    """A servo moved against the way it was sent."""
    MOVED_TOO_FAR = 701
    """A servo moved much further than it was sent."""
    MOVED_ANOTHER = 702
    """Another servo moved than the one that was sent."""
    NOT_ARRIVED = 703
    """A servo did not arrive in time."""

    @classmethod
    def of(cls, number: int) -> Code:
        """Returns the code of a number that another version may have sent; OTHER for one that is unknown."""
        try:
            return cls(number)
        except ValueError:
            return cls.OTHER


NO_REASON = 0xFFFF
"""Number that stands on wires and in recordings where there is no reason."""


@dataclass(frozen=True, slots=True)
class Reason:
    """The cause of a refusal, hold or stop. Programs compare `code`; `text` is for people only."""

    code: Code
    text: str

    def __str__(self) -> str:
        return self.text

    @classmethod
    def of(cls, given: Reason | str) -> Reason:
        """Returns a reason as it is; a text alone, as operators give it, has the code OTHER."""
        return given if isinstance(given, Reason) else cls(Code.OTHER, str(given))


def number_of(reason: Reason | None) -> int:
    """Returns the number of a reason's code; NO_REASON for none."""
    return NO_REASON if reason is None else int(reason.code)


def text_of(reason: Reason | None) -> str:
    """Returns the text of a reason; an empty one for none."""
    return "" if reason is None else reason.text


def reason_of(number: int, text: str) -> Reason | None:
    """Returns the reason of a number and a text that were sent or recorded."""
    return None if number == NO_REASON else Reason(Code.of(number), text)


def kind_of(reason: str) -> str:
    """A reason without its figures: the same one with another figure is no news. Names keep their digits."""
    return re.sub(r"\b\d[\d.]*", "", reason)


@dataclass(frozen=True, slots=True)
class Notice:
    """One kind of reason: words and time of the first, and the count of all."""

    words: str
    """Words of the first."""
    time: float
    """Time [s] of the first."""
    count: int
    """Number of reasons of this kind."""
    code: Code = Code.OTHER
    """Code of the first."""

    def __str__(self) -> str:
        return f"{self.count} x, first at {self.time:.3f} s: {self.words}"

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "words": self.words,
            "time_s": round(self.time, 4),
            "count": self.count,
            "code": self.code.name,
        }


class ReasonCounter:
    """Counts each kind of reason, by the words that came first. It never holds more than MOST + 1."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}
        self._begun: dict[str, tuple[float, Code]] = {}

    def add(self, reason: Reason, now: float) -> bool:
        """Count a reason, which came at `now` [s]. Returns whether it is the first of a kind that is kept."""
        kind = kind_of(reason.text)
        is_new = kind not in self._first
        if is_new and len(self._first) >= MOST:
            words, is_new = OTHERS, False
        else:
            words = self._first.setdefault(kind, reason.text)
        self._begun.setdefault(words, (now, reason.code if words is not OTHERS else Code.OTHER))
        self.counts[words] += 1
        return is_new

    def notices(self) -> tuple[Notice, ...]:
        """One notice for each kind, in the order in which they first came."""
        return tuple(
            Notice(words, self._begun[words][0], count, self._begun[words][1])
            for words, count in self.counts.items()
        )
