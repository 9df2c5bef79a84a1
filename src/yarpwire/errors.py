"""All errors of yarpwire, with a common root."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class YarpError(Exception):
    """Root of all errors that yarpwire raises on purpose."""


class WireError(YarpError):
    """A message that violates the protocol, or a value that it can't express. It was dropped."""


class RepetitionError(YarpError):
    """A valid message without new data: its sender works, but the sensor has no new measurement."""


class PortError(YarpError):
    """A port, name server or control board can't be opened or reached, does not answer, or refuses."""


class UnknownNameError(PortError):
    """A name that is not registered; the message lists the registered ones, and the nearest of them."""

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.valid = tuple(valid)
        near = get_close_matches(name[:60], self.valid[:1000], n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        super().__init__(f"no {kind} named {name!r}{meant}; valid: {', '.join(self.valid) or '(none)'}")


class CallError(YarpError):
    """A call or a command that is unknown to a served control board or impossible for it."""


class BindingsError(YarpError):
    """YARP's own Python bindings can't be imported; `advice` says how to get them."""

    def __init__(self, missing: str, advice: str) -> None:
        self.missing, self.advice = missing, advice
        super().__init__(f"{missing} can't be imported; {advice}")
