"""Results that are computed once for each robot."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from tci.robot.description import Robot

Rest = ParamSpec("Rest")
Result = TypeVar("Result")


def per_robot(
    make: Callable[Concatenate[Robot, Rest], Result],
) -> Callable[Concatenate[Robot, Rest], Result]:
    """Caches the results of a function for each robot and all other arguments of the function, as long as the
    robot object exists.

    Robots are distinguished by object identity. An `lru_cache` would compare all fields of equal robots in
    each period, which takes too long.
    """
    found: dict[Hashable, Result] = {}

    @wraps(make)
    def result(robot: Robot, /, *args: Rest.args, **names: Rest.kwargs) -> Result:
        key: Hashable = (id(robot), *args, *names.items()) if args or names else id(robot)
        if key not in found:
            found[key] = make(robot, *args, **names)
            weakref.finalize(robot, found.pop, key, None).atexit = False
        return found[key]

    return result
