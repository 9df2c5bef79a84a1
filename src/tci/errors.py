"""All errors that TCI raises, and the reasons to refuse, hold or stop.

All errors have one root class, so a caller can catch all of them. Messages name the wrong value, its place,
and the valid values.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from tci.reasons import Code, Notice, Reason

__all__ = [
    "ClashError",
    "Code",
    "CommandError",
    "DescriptionError",
    "DriverError",
    "Fault",
    "FrameError",
    "MissingExtraError",
    "Notice",
    "Reason",
    "RecordingError",
    "TciError",
    "UnknownNameError",
    "WireError",
]


class TciError(Exception):
    """Root of all errors that TCI raises on purpose."""

    code = Code.OTHER
    """Cause of the error, for programs."""

    def __init__(self, *words: object, code: Code | None = None) -> None:
        """Stores the `code` of this error. Without `code`, the error has the code of its class."""
        super().__init__(*words)
        if code is not None:
            self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        """Errors cross to other processes whole: the message is kept, not made again from it."""
        return _again, (type(self), self.args), self.__dict__

    @property
    def reason(self) -> Reason:
        """Returns the error as a reason to refuse or to stop."""
        return Reason(self.code, str(self))


def _again(kind: type[TciError], words: tuple[object, ...]) -> TciError:
    return kind.__new__(kind, *words)


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault in a file."""

    line: int
    """Line in the file, from 1; 0 for a fault without a line."""
    message: str
    """One sentence that names the fault and says what would be valid."""

    def __str__(self) -> str:
        return f"line {self.line}: {self.message}" if self.line else self.message


class DescriptionError(TciError):
    """Faults of a robot description. The message lists all faults of the file."""

    def __init__(self, source: str, faults: Sequence[Fault]) -> None:
        self.source = source
        self.faults = tuple(faults)
        count = f"{len(self.faults)} fault{'s' if len(self.faults) != 1 else ''}"
        super().__init__("\n".join([f"{source}: {count}", *(f"  {fault}" for fault in self.faults)]))


def nearest_name(name: str, valid: Iterable[str]) -> str | None:
    """Returns the valid name that is most similar to an unknown name; None if no name is similar."""
    from difflib import get_close_matches  # imported on an error only: keeps `import tci` fast

    names = [*valid][:1000]
    lower = {one.lower(): one for one in names}
    close = get_close_matches(name[:60], names, n=1)
    close = close or [lower[one] for one in get_close_matches(name[:60].lower(), lower, n=1)]
    return close[0] if close else None


def meant(name: str, valid: Iterable[str]) -> str:
    """Returns the text ` (did you mean ...?)` with the valid name that is most similar to an unknown name; an
    empty text if no name is similar."""
    near = nearest_name(name, valid)
    return "" if near is None else f" (did you mean {near!r}?)"


class UnknownNameError(TciError):
    """Unknown name. The message lists the valid names, and suggests the valid name that is most similar."""

    code = Code.UNKNOWN_NAME

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.kind = kind
        self.name = name
        self.valid = tuple(valid)
        listed = ", ".join(self.valid) or "(none)"
        super().__init__(f"no {kind} named {name!r}{meant(str(name), self.valid)}; valid: {listed}")


class CommandError(TciError):
    """Command or argument with a wrong shape, value or mode. TCI has sent nothing."""

    code = Code.COMMAND_INVALID


class FrameError(TciError):
    """Skin frame or joint reading that does not fit the robot. TCI has not used it."""

    code = Code.SKIN_MISFIT


class DriverError(TciError):
    """Driver or server that can't be opened, is closed or fails; or a command that the driver's gate did not
    create."""


class WireError(TciError):
    """Data from a network that violates the protocol. TCI has dropped this data."""


class RecordingError(TciError):
    """Recording that can't be written, that is not a recording, or that was made with another robot."""


class MissingExtraError(TciError):
    """Missing package. The message, composed by `tci.support.installed`, contains the command to install the
    package."""

    def __init__(self, what: str, missing: str, advice: str) -> None:
        self.missing = missing
        self.advice = advice
        super().__init__(f"{what} needs {missing}, which is not installed; {advice}")


class ClashError(TciError):
    """Package that can't be loaded because another package has overwritten some of its files."""
