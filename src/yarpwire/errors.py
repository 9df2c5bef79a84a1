"""All errors of yarpwire. Their base class is `YarpError`."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class YarpError(Exception):
    """Base class of all errors that yarpwire raises on purpose."""


class WireError(YarpError):
    """A message that violates the protocol, or a value that the protocol can't express. The message was
    dropped."""


class RepetitionError(YarpError):
    """A valid message without new data: the sender works, but the sensor has no new measurement."""


class PortError(YarpError):
    """A port, name server or control board can't be opened or reached, does not answer, or refuses a
    request."""


class UnknownNameError(PortError):
    """A name that is not registered. The error message lists the registered names, and suggests the most
    similar one."""

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.valid = tuple(valid)
        near = get_close_matches(name[:60], self.valid[:1000], n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        super().__init__(f"no {kind} named {name!r}{meant}; valid: {', '.join(self.valid) or '(none)'}")


class CallError(YarpError):
    """A call or command that a served control board does not know or can't execute."""


class BindingsError(YarpError):
    """YARP's own Python bindings can't be imported. `advice` says how to install them."""

    def __init__(self, missing: str, advice: str) -> None:
        self.missing, self.advice = missing, advice
        super().__init__(f"{missing} can't be imported; {advice}")
