"""Every error that yarpwire raises. One root, so that a caller can catch them all."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class YarpError(Exception):
    """Root of all errors that yarpwire raises on purpose."""


class WireError(YarpError):
    """A message is not what the protocol allows, or a value has no form in it. It was dropped."""


class PortError(YarpError):
    """A port, name server or control board can't be opened or reached, does not answer, or refuses."""


class UnknownNameError(PortError):
    """A name that nobody has registered; the message lists those that are there, and the nearest of them."""

    def __init__(self, kind: str, name: str, valid: Iterable[str]) -> None:
        self.valid = tuple(valid)
        near = get_close_matches(name[:60], self.valid[:1000], n=1)
        meant = f"; did you mean {near[0]!r}?" if near else ""
        super().__init__(f"no {kind} named {name!r}{meant}; valid: {', '.join(self.valid) or '(none)'}")


class CallError(YarpError):
    """A call or a command to a served control board that it does not know or can't do."""


class BindingsError(YarpError):
    """YARP's own Python bindings can't be imported; `advice` says how to get them."""

    def __init__(self, missing: str, advice: str) -> None:
        self.missing, self.advice = missing, advice
        super().__init__(f"{missing} can't be imported; {advice}")
