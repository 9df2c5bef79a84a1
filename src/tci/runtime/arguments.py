"""Checks of user-supplied arguments: accepted if their meaning is clear, otherwise refused with what is
valid."""

from __future__ import annotations

import math
from inspect import isabstract
from typing import Any

from tci.capabilities.capability import Capability
from tci.capabilities.orders import named
from tci.drivers.driver import Driver
from tci.errors import TciError


def as_driver(given: object) -> Driver:
    """Returns a connection to a robot. Raises TciError for a robot, a name or anything else."""
    if isinstance(given, Driver):
        return given
    raise TciError(
        f"run: {named(given)} in place of the connection to a robot; "
        "valid: driver, from `with tci.connect('nao', 'sim') as driver:`"
    )


def as_capability(given: Any) -> Capability[Any]:
    """Returns a capability; from its class one with its default settings. Raises TciError."""
    if isinstance(given, Capability):
        return given
    if isinstance(given, type) and issubclass(given, Capability):
        if isabstract(given):
            lacks = " and ".join(sorted(given.__abstractmethods__))
            raise TciError(f"run: {named(given)} lacks {lacks}; valid: a subclass that has them")
        try:
            return given()
        except TypeError as error:
            raise TciError(
                f"run: {named(given)} needs settings: {error}; valid: {given.__name__}(...), "
                "or defaults for all of them"
            ) from error
    raise TciError(
        f"run: {named(given)} in place of a capability; valid: tci.WithdrawalReflex(), "
        "or an instance of your own subclass of tci.Capability"
    )


def check_duration(duration: float | None) -> None:
    """Raises TciError for an invalid duration [s]."""
    if duration is not None and not (0.0 <= duration < math.inf):
        raise TciError(f"run: duration {duration} s; valid: 0 or more and finite, or None for ever")
