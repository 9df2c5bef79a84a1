"""Reasons to refuse, clamp, hold or stop: a code for programs, a text for people."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from enum import IntEnum, unique
from math import ceil, inf, log10
from typing import Any

MOST = 100
"""Largest number of kinds of reasons that are counted separately. Assumed: nobody reads a longer list."""
FIGURES = re.compile(r"\b\d[\d.]*")
"""Pattern that finds the numbers in a text, but not the digits in names."""
OTHERS = "other reasons"
"""Name under which all further reasons are counted together, once `MOST` kinds are counted separately."""


def decimals(value: float, bound: float, least: int) -> int:
    """How many decimals show that `value` is not `bound`: `least`, or more."""
    apart = abs(value - bound)
    return max(least, ceil(-log10(apart))) if 0.0 < apart < inf else least


@unique
class Code(IntEnum):
    """Cause of a refusal, a hold, a stop or a fault.

    Recordings, and messages on networks, contain these numbers. So each new cause gets a new number, and the
    number of a removed cause is never used again.
    """

    OTHER = 0
    """A cause without a separate code, such as a reason from an operator or a user's program."""

    JOINTS_STALE = 100
    """The joint data is too old, or the robot marks it as invalid."""
    JOINTS_MISFIT = 101
    """The joint data has a wrong number of joints, or angles that are not finite."""
    JOINTS_REPEATED = 102
    """Identical joint data arrives with new stamps."""
    TIME_WENT_BACK = 103
    """The time of a command is earlier than the time of the previous command."""

    FOLLOWING_ERROR = 200
    """A servo does not follow its reference."""
    OPPOSED_MOTION = 201
    """A servo moves against its reference."""
    ENCODER_JUMPED = 202
    """An angle changed faster than the servo can move."""
    ENCODER_FROZEN = 203
    """An angle stays constant while the servo must move."""
    ENCODER_DISAGREES = 204
    """An angle contradicts the measured velocity."""
    SERVO_OFF = 205
    """A servo under command is switched off."""
    SERVO_MODE = 206
    """A servo reports a control mode that differs from the commanded mode."""

    PERIODS_MISSED = 300
    """The loop missed periods."""
    PROCESS_FROZEN = 301
    """The operating system did not run this process for some time."""
    HEARTBEAT_MISSING = 302
    """A required process sends no heartbeat."""
    RUN_ENDED = 303
    """The run has ended."""
    PROGRAM_FAILED = 304
    """The program raised an exception or was interrupted."""
    CALLER_SILENT = 305
    """The program that steps the robot gave no orders for too long."""

    SKIN_SILENT = 400
    """A patch of skin stopped sending."""
    SKIN_MISFIT = 401
    """Frames of the skin do not fit the robot."""
    SKIN_BLIND = 402
    """Too few taxels are trusted in a region of the skin that the capability needs."""

    COMMAND_INVALID = 500
    """A command has a type, shape or value that no robot accepts."""
    UNKNOWN_NAME = 501
    """A command names a part, joint or servo that the robot does not have."""
    GATE_CLOSED = 502
    """The gate refuses a command because the gate holds or has stopped."""
    WRONG_MODE = 503
    """The mode of a command differs from the control mode of the servo, or the servo does not support the
    requested mode."""
    LIKELY_DEGREES = 504
    """Angles are so large that they may be degrees."""
    LIMITS_UNKNOWN = 505
    """The description lacks limits that are required to move a servo."""
    LIMITS_EXCEEDED = 506
    """A measured or commanded angle is too far outside its limits; or a compliant servo has yielded so far
    that its stiffness can't be raised."""
    IN_MOTION = 507
    """The command requires that the servo is at rest."""
    SELF_COLLISION = 508
    """Two links of the robot would come too close to each other."""
    OUT_OF_REACH = 509
    """The robot can't reach the target in any posture."""
    NOT_ARMED = 510
    """The driver is read-only, or the robot has not been read yet."""
    CLAMPED = 511
    """A value outside the limits was replaced by the nearest value within the limits."""
    CONTACT = 513
    """A part met something on its way, or is still held there."""
    SWITCHES_AT_REST = 512
    """A moving servo is braked, and changes its control mode when it rests."""

    OVERTAKEN = 514
    """An order came while its part met something, so its sender could not know: it ended with the motion."""

    OTHER_COMMANDER = 600
    """Another process commands these joints."""
    COMMANDER_SILENT = 601
    """A process that commands the robot stopped sending."""
    COMMANDER_HOLDS = 602
    """A process that commands the robot requests that the robot holds."""
    COMMANDER_LEFT = 603
    """A process that commanded the robot has disconnected."""
    OWNER_HOLDS = 604
    """The gate in the process that owns the robot is in the state HOLD or STOP."""
    OWNER_REFUSES = 605
    """The process that owns the robot refused a command."""
    OWNER_SILENT = 606
    """The process that owns the robot does not acknowledge commands."""
    OWNER_RESTARTED = 607
    """The process that owns the robot was restarted."""
    HALTED = 608
    """The process that commands the robot called `halt`, the driver's own stop."""
    MOVED_BY_ITSELF = 609
    """The robot moves without a command of TCI, or a program on the robot may move it."""
    ROBOT_REFUSES = 610
    """The robot's own controllers refuse commands, or can't be reached."""

    MOVED_WRONG_WAY = 700
    """A servo moved opposite to its command."""
    MOVED_TOO_FAR = 701
    """A servo moved much farther than commanded."""
    MOVED_ANOTHER = 702
    """A servo moved that was not commanded."""
    NOT_ARRIVED = 703
    """A servo did not arrive in time."""

    @classmethod
    def of(cls, number: int) -> Code:
        """Returns the code with this number, or OTHER for an unknown number, for example from a newer version
        of TCI."""
        try:
            return cls(number)
        except ValueError:
            return cls.OTHER


NO_REASON = 0xFFFF
"""Number that means "no reason" in messages and recordings."""


@dataclass(frozen=True, slots=True)
class Reason:
    """The cause of a refusal, clamp, hold or stop. Programs read `code` and `names`; `text` is for people."""

    code: Code
    text: str
    names: tuple[str, ...] = ()
    """Name of the servo for the code CLAMPED, names of the two links for the code SELF_COLLISION. The tuple
    is empty for other codes, and for a reason from another process."""

    def __str__(self) -> str:
        return self.text

    @classmethod
    def of(cls, given: Reason | str) -> Reason:
        """Returns a reason unchanged. Converts a text to a reason with the code OTHER."""
        return given if isinstance(given, Reason) else cls(Code.OTHER, str(given))


def number_of(reason: Reason | None) -> int:
    """Returns the number of a reason's code. If `reason` is None, returns 65535 (NO_REASON), which is no
    code."""
    return NO_REASON if reason is None else int(reason.code)


def text_of(reason: Reason | None) -> str:
    """Returns the text of a reason; an empty text if `reason` is None."""
    return "" if reason is None else reason.text


def reason_of(number: int, text: str) -> Reason | None:
    """Returns the reason that a message or recording contains as `number` and `text`; None if the number
    means "no reason"."""
    return None if number == NO_REASON else Reason(Code.of(number), text)


def kind_of(reason: str) -> str:
    """Returns the text of a reason without its numbers. So two texts that differ only in a number count as
    one kind. Digits in names are kept."""
    return FIGURES.sub("", reason)


@dataclass(frozen=True, slots=True)
class Notice:
    """One kind of reason: text and time of its first occurrence, and the number of occurrences."""

    words: str
    """Text of the first occurrence."""
    time: float
    """Time [s] of the first occurrence."""
    count: int
    """Number of occurrences."""
    code: Code = Code.OTHER
    """Code of the first occurrence."""

    def __str__(self) -> str:
        return f"{self.count} x, first at {self.time:.3f} s: {self.words}"

    def to_json(self) -> dict[str, Any]:
        """Returns the notice as plain values for JSON."""
        return {
            "words": self.words,
            "time_s": round(self.time, 4),
            "count": self.count,
            "code": self.code.name,
        }


class ReasonCounter:
    """Counts reasons by kind. If there are more than `MOST` kinds, all further kinds are counted as one."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}
        self._begun: dict[str, tuple[float, Code]] = {}

    def add(self, reason: Reason, now: float) -> bool:
        """Counts a reason that occurs at `now` [s]. Returns True if this reason is the first of its kind:
        texts that differ only in numbers are one kind. Returns False if `MOST` other kinds occurred before.
        """
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
        """Returns one notice for each kind of reason, in the order of first occurrence. Another thread may go
        on counting."""
        counts = [*self.counts.items()]  # a copy in one step
        return tuple(
            Notice(words, self._begun[words][0], count, self._begun[words][1]) for words, count in counts
        )
