"""Scalar functions in plain Python that numba and Warp compile as they are: one source for all engines."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import BuiltinFunctionType, FunctionType, ModuleType, SimpleNamespace
from typing import Any


def made_with(decorate: Callable[[Any], Any], module: ModuleType, maths: Any = math) -> Any:
    """The functions of `module`, each compiled by `decorate` (numba's or Warp's), as attributes by their
    names. `maths` has the functions that stand in for those of `math`: Warp itself for Warp."""
    own: dict[str, Any] = {**vars(module)}
    for name, function in vars(module).items():
        if isinstance(function, BuiltinFunctionType) and function.__module__ == "math":
            own[name] = getattr(maths, name)
    for name, function in vars(module).items():
        if isinstance(function, FunctionType) and function.__module__ == module.__name__:
            # A copy whose calls find the compiled functions instead of the plain ones.
            copy = FunctionType(function.__code__, own, name)
            copy.__annotations__, copy.__module__ = function.__annotations__, module.__name__
            own[name] = decorate(copy)
    return SimpleNamespace(**own)
