"""Settings for what TCI adds to a user's model, on which the model's own settings have no effect.

An MJCF file's `<default>` applies to every element that states no value of its own, also to elements that are
added later: with `<joint damping="5"/>` the tip of the simulated finger would stick in syrup.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tci.support.engine import mujoco

NAME = "tci"
KINDS = ("actuator", "geom", "joint", "mesh")
_OWN = ("alt", "classname", "compiler", "frame", "id", "info", "name", "parent", "plugin", "signature")
"""What belongs to one element, not to its kind. MuJoCo crashes when a default class is asked for it."""
_PLAIN = mujoco.MjSpec()


def neutral(spec: mujoco.MjSpec) -> mujoco.MjsDefault:
    """MuJoCo's own defaults, as a class of the model. All that TCI adds belongs to it."""
    found = spec.find_default(NAME)
    if found is None:
        found = spec.add_default(NAME, spec.default)
        for kind in KINDS:
            _copy(getattr(_PLAIN.default, kind), getattr(found, kind))
    return found


def plain_options(spec: mujoco.MjSpec) -> None:
    """Replaces what the file says about the physics (`<option>`), such as a medium, wind, or contact settings
    that override all others: it belongs to the file's world, not to the robot."""
    _copy(_PLAIN.option, spec.option)


def _copy(source: Any, target: Any) -> None:
    for name in dir(source):
        if name.startswith("_") or name in _OWN:
            continue
        value = getattr(source, name)
        if isinstance(value, int | float | np.ndarray) or type(value).__name__.startswith("mjt"):
            setattr(target, name, value)
