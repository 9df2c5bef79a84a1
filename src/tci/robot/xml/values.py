"""Kinds of values in a description. Each kind has a text that lists the valid values.

Numbers are plain ASCII decimals. Python's `float` accepts more forms (nan, inf, 1_0, other digits, spaces
around a number). These forms are refused, because they are usually mistakes.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from tci.robot.description import Vector

Unit = Literal["deg", "rad"]

MAX_ANGLE = 4.0 * math.pi
"""Largest valid angle [rad]. Assumed: no joint turns further than two turns, so a larger angle is in the
wrong unit."""

PLACES = 6
"""Number of decimals of a number that is written. The last decimal is 1 um for lengths, and a millionth of a
degree for angles."""
NUMBER = r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]{1,3})?"
"""Pattern of a plain ASCII decimal."""
_NUMBER = re.compile(NUMBER)
_INTEGER = re.compile(r"[0-9]{1,9}")


class InvalidValueError(ValueError):
    """Error that contains the valid values. The reader catches this error and adds the place and the wrong
    value."""


class ImplausibleError(InvalidValueError):
    """An angle that is too large for any robot, so that it is probably in the wrong unit."""


def to_rad(value: float, unit: Unit) -> float:
    """Converts `value` from `unit` to radians."""
    return math.radians(value) if unit == "deg" else value


def in_unit(angle: float, unit: Unit) -> str:
    """Returns an angle [rad] as text in the unit of the file, such as `15 deg`."""
    return f"{round(math.degrees(angle), 6) if unit == 'deg' else round(angle, 9):.9g} {unit}"


class Value(ABC):
    """The form of one attribute value, or of the text of one element."""

    angular = False
    """True if the file's angle unit applies to the value, as for an angle or a speed."""

    @abstractmethod
    def read(self, text: str, unit: Unit) -> object:
        """Returns the value of `text` in SI units and radians. Raises InvalidValueError if `text` is not
        valid."""

    def write(self, value: Any) -> str:
        """Returns the text of a value. Angles are written in degrees. This is the inverse of `read`."""
        return str(value)

    @property
    def says(self) -> str:
        """Short description of the valid values, in Markdown; empty if the name of the attribute is
        sufficient."""
        return ""


@dataclass(frozen=True)
class Name(Value):
    """A name of printable characters, without spaces at its ends."""

    longest: int = 100

    def read(self, text: str, unit: Unit) -> str:
        if not text or len(text) > self.longest or not text.isprintable() or text != text.strip():
            raise InvalidValueError(f"a name of 1 to {self.longest} printable characters")
        return text


@dataclass(frozen=True)
class Choice(Value):
    """One of several keywords."""

    valid: tuple[str, ...]

    def read(self, text: str, unit: Unit) -> str:
        if text not in self.valid:
            raise InvalidValueError(f"valid: {', '.join(self.valid)}")
        return text

    @property
    def says(self) -> str:
        return ", ".join(f"`{word}`" for word in self.valid)


class Flag(Value):
    """True or false."""

    words = Choice(("true", "false"))

    def read(self, text: str, unit: Unit) -> bool:
        return self.words.read(text, unit) == "true"

    def write(self, value: bool) -> str:
        return "true" if value else "false"

    @property
    def says(self) -> str:
        return self.words.says


@dataclass(frozen=True)
class Choices(Value):
    """One or more keywords, separated by spaces. Each keyword may occur only once."""

    valid: tuple[str, ...]

    def read(self, text: str, unit: Unit) -> tuple[str, ...]:
        words = tuple(word for word in text.split(" ") if word)
        if not words or len(set(words)) != len(words) or not set(words) <= set(self.valid):
            raise InvalidValueError(f"one or more of {', '.join(self.valid)}, each once, with spaces between")
        return words

    def write(self, value: Iterable[str]) -> str:
        return " ".join(value)

    @property
    def says(self) -> str:
        return "some of " + ", ".join(f"`{word}`" for word in self.valid)


@dataclass(frozen=True)
class Integer(Value):
    """A whole number, not negative."""

    least: int = 0
    most: int = 1_000_000
    word: str | None = None
    """Keyword that is valid instead of a number. For this keyword, `read` returns the keyword itself."""

    def read(self, text: str, unit: Unit) -> int | str:
        if text == self.word:
            return text
        if not _INTEGER.fullmatch(text) or not self.least <= int(text) <= self.most:
            also = f", or the word {self.word}" if self.word else ""
            raise InvalidValueError(f"a whole number from {self.least} to {self.most}{also}")
        return int(text)

    @property
    def says(self) -> str:
        return f"number or `{self.word}`" if self.word else ""


@dataclass(frozen=True)
class Integers(Value):
    """One or more different whole numbers, separated by spaces."""

    of: Integer = Integer()

    def read(self, text: str, unit: Unit) -> tuple[int, ...]:
        found = tuple(int(self.of.read(word, unit)) for word in text.split(" ") if word)
        if not found or len({*found}) != len(found):
            raise InvalidValueError("one or more whole numbers, each once, with spaces between")
        return found

    def write(self, value: Iterable[int]) -> str:
        return " ".join(map(str, value))

    @property
    def says(self) -> str:
        return "numbers"


@dataclass(frozen=True)
class Number(Value):
    """A number within bounds."""

    least: float = -1e12
    most: float = 1e12
    positive: bool = False
    """True if the number must be above 0."""
    unit: str = ""
    """Unit of the number, as messages show it."""

    def read(self, text: str, unit: Unit) -> float:
        value = decimal(text)
        if self.positive and value <= 0.0:
            raise InvalidValueError(f"a number above 0{self._unit}")
        if not self.least <= value <= self.most:
            least = "above 0" if self.positive else f"from {self.least:g}"
            raise InvalidValueError(f"a number {least} to {self.most:g}{self._unit}")
        return value

    def write(self, value: float) -> str:
        return f"{round(value, PLACES) + 0.0:.10g}"  # no -0

    @property
    def says(self) -> str:
        return (
            f"{self.least:g} to {self.most:g}" if self.most == 1.0 else f"[{self.unit}]" if self.unit else ""
        )

    @property
    def _unit(self) -> str:
        return f" [{self.unit}]" if self.unit else ""


@dataclass(frozen=True)
class Factor(Value):
    """A transform factor (gamma in eq. 1). The sign may be positive or negative; the absolute value is
    bounded."""

    least: float = 1e-3
    most: float = 1e3

    def read(self, text: str, unit: Unit) -> float:
        value = decimal(text)
        if not self.least <= abs(value) <= self.most:
            raise InvalidValueError(f"a factor whose size is {self.least:g} to {self.most:g}, of either sign")
        return value

    def write(self, value: float) -> str:
        return f"{value:.9g}"

    @property
    def says(self) -> str:
        return f"{self.least:g} to {self.most:g} in size, any sign"


@dataclass(frozen=True)
class Angle(Value):
    """An angle or its derivative (speed, acceleration, jerk), in radians."""

    positive: bool = False
    most: float = MAX_ANGLE
    """Largest plausible absolute value [rad, rad/s, rad/s2 or rad/s3]. Assumed: a larger value is in the
    wrong unit."""
    per: str = ""
    """Unit of time of a derivative, as messages show it: `/s`, `/s2`, `/s3`."""

    angular = True

    def read(self, text: str, unit: Unit) -> float:
        value = to_rad(decimal(text), unit)
        if self.positive and value <= 0.0:
            raise InvalidValueError(f"a number above 0 [{unit}{self.per}]")
        if abs(value) > self.most:
            most = in_unit(self.most, unit)
            raise ImplausibleError(f"implausible in {unit}{self.per}, at most {most}{self.per}; wrong unit?")
        return value

    def write(self, value: float) -> str:
        return f"{round(math.degrees(value), PLACES) + 0.0:.10g}"

    @property
    def says(self) -> str:
        return f"angle{self.per}"


@dataclass(frozen=True)
class Three(Value):
    """Three values of one kind, separated by spaces."""

    of: Value

    @property
    def angular(self) -> bool:  # type: ignore[override] # that of its values
        """True if the file's angle unit applies to the three values."""
        return self.of.angular

    def read(self, text: str, unit: Unit) -> Vector:
        words = [word for word in text.split(" ") if word]
        if len(words) != 3:
            raise InvalidValueError(f"3 numbers with spaces between them, not {len(words)}")
        x, y, z = (self.of.read(word, unit) for word in words)
        assert isinstance(x, float) and isinstance(y, float) and isinstance(z, float)
        return x, y, z

    def write(self, value: Vector) -> str:
        return " ".join(map(self.of.write, value))

    @property
    def says(self) -> str:
        return f"3 x {self.of.says}"


@dataclass(frozen=True)
class RelativePath(Value):
    """A path below a folder, with forward slashes. The path can't lead out of this folder."""

    def read(self, text: str, unit: Unit) -> str:
        steps = text.split("/")
        plain = text.isprintable() and not set(text) & set('\\:*?"<>|')
        if not plain or len(text) > 400 or any(step.strip() in ("", ".", "..") for step in steps):
            raise InvalidValueError(
                "a relative path with forward slashes and without '..', such as skin/left.csv"
            )
        return text


def decimal(text: str) -> float:
    """Returns the finite number that `text` contains as an ASCII decimal. Raises InvalidValueError for all
    other texts."""
    value = float(text) if len(text) <= 60 and _NUMBER.fullmatch(text) else math.nan
    if not math.isfinite(value):
        raise InvalidValueError("a finite decimal number such as -12.5 or 1e-3")
    return value
