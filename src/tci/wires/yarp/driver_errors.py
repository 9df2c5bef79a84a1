"""Conversion of the errors of yarpwire to TCI's errors, so that callers get DriverError instead of
YarpError."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from tci.errors import DriverError, MissingExtraError, TciError
from yarpwire.errors import BindingsError, YarpError

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def raises_driver_errors(call: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Returns a function that calls the wrapped function and raises each YarpError as DriverError with the
    same text."""

    @wraps(call)
    def translated(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        try:
            return call(*args, **kwargs)
        except YarpError as error:
            raise driver_error(error) from error

    return translated


def driver_error(error: YarpError) -> TciError:
    """Returns a DriverError with the text of `error`, or a MissingExtraError if YARP's own bindings are not
    installed."""
    if isinstance(error, BindingsError):
        advice = f"{error.advice}. TCI speaks YARP itself: leave out `bindings`"
        return MissingExtraError("yarp:bindings", error.missing, advice)
    return DriverError(str(error))
