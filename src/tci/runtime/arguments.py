"""Checks of arguments that the user gives.

TCI accepts an argument only if its meaning is clear. Otherwise TCI raises an error, whose message lists the
valid values.
"""

from __future__ import annotations

import ast
import math
import sys
from importlib import import_module
from importlib.metadata import entry_points
from inspect import isabstract
from pathlib import Path
from typing import Any, SupportsFloat

from tci.capabilities.capability import Capability, lacks
from tci.capabilities.fields import load_fields
from tci.capabilities.orders import named
from tci.capabilities.policy.capability import PolicyCapability
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.drivers.driver import Driver
from tci.errors import CommandError, TciError, UnknownNameError
from tci.robot.description import Robot

GROUP = "tci.capabilities"
"""Group of the entry points of capabilities."""
POLICY, FIELDS = ".onnx", ".toml"
"""Endings of the file of a policy, and of a file of receptive fields."""


def as_driver(given: object, call: str = "run") -> Driver:
    """Returns `given` if it is a connection to a robot. `call` is what the user called.

    Raises TciError if `given` is anything else, for example a robot or a name.
    """
    if isinstance(given, Driver):
        return given
    raise TciError(
        f"{call}: {named(given)} in place of the connection to a robot; "
        "valid: driver, from `with tci.connect('nao', 'sim') as driver:`"
    )


def as_capability(given: Any) -> Capability[Any]:
    """Returns the capability `given`. If `given` is a class, returns an instance of this class with default
    settings. Raises TciError if `given` is neither a capability nor a class of capabilities, if the class is
    abstract, or if the class needs settings.
    """
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


def load_capability(name: str) -> Capability[Any]:
    """Returns a capability. `name` is the name of an entry point, the path of a policy (.onnx) or of the
    withdrawal reflex's fields (.toml), or MODULE:NAME, of a class with default settings for everything, or of
    an instance with settings of its own.

    The module may be in the working directory. Raises UnknownNameError for an unknown name. Raises
    CommandError if the module can't be imported, or if the object with this name is no subclass of
    Capability. Raises TciError if the class is abstract or needs settings.
    """
    points = {point.name: point for point in entry_points(group=GROUP)}
    if name in points:
        found = points[name].load()
    elif name.endswith(POLICY):
        return PolicyCapability(name)
    elif name.endswith(FIELDS):
        return WithdrawalReflex(
            fields=load_fields(name), surround=load_fields(name, surround=True) or load_fields(name)
        )
    elif ":" in name:
        found = _from_module(*name.split(":", 1))
    else:
        others = [*_in_folder(name), "MODULE:CLASS", f"fields ({FIELDS})", f"or a policy ({POLICY})"]
        raise UnknownNameError("capability", name, [*sorted(points), *others])
    if not (isinstance(found, Capability) or (isinstance(found, type) and issubclass(found, Capability))):
        raise CommandError(
            f"{name} is {named(found)}, no capability; valid: a subclass of tci.Capability, or an instance"
        )
    return as_capability(found)


def capabilities_for(robot: Robot) -> list[str]:
    """The named capabilities for which a robot has what they need. One that can't be loaded is left out: it
    tells why when somebody runs it."""
    found = []
    for name in sorted({point.name for point in entry_points(group=GROUP)}):
        try:
            if not lacks(load_capability(name), robot):
                found.append(name)
        except Exception:  # entry points of other packages may raise anything
            continue
    return found


def _from_module(module: str, name: str) -> object:
    """Imports the module `module` and returns the object `name` of this module. The module may be in the
    working directory."""
    valid = "valid: MODULE:CLASS, such as my_file:Shrug for the class Shrug in my_file.py"
    if module.startswith("."):  # Python would read a leading dot as a relative import
        raise CommandError(f"{module}:{name}: a path is no module; {valid}")
    sys.path.insert(0, "")
    try:
        found = import_module(module)
    except (ImportError, ValueError) as error:
        raise CommandError(
            f"{module}:{name}: {error}; searched: {Path.cwd()} and the installed packages; {valid}"
        ) from error
    if not hasattr(found, name):
        # a package may import its objects only on first use
        words = dict.fromkeys([*vars(found), *dir(found)])
        own = [word for word in words if _can_run(getattr(found, word, None))]
        raise UnknownNameError(f"capability in {module}", name, own)
    return getattr(found, name)


def _in_folder(module: str) -> list[str]:
    """Returns MODULE:CLASS for each class with a base class in MODULE.py of the working directory. The list
    is empty if there is no such file, or if it is no valid Python file."""
    try:
        tree = ast.parse(Path(f"{module}.py").read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):
        return []
    return [f"{module}:{node.name}" for node in tree.body if isinstance(node, ast.ClassDef) and node.bases]


def _can_run(one: object) -> bool:
    """Returns True if `one` is a class of capabilities that is neither abstract nor wrong."""
    return isinstance(one, type) and issubclass(one, Capability) and not (isabstract(one) or one.wrong)


def check_duration(duration: float | None) -> None:
    """Raises TciError if `duration` [s] is negative, infinite or not a number. None is valid."""
    if duration is None:
        return
    if isinstance(duration, str | bool) or not isinstance(duration, SupportsFloat):
        raise TciError(f"run: duration {duration!r}; valid: a number of seconds, or None for ever")
    if not (0.0 <= float(duration) < math.inf):
        raise TciError(f"run: duration {duration} s; valid: 0 or more and finite, or None for ever")
