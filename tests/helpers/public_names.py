"""All public names: those of `tci`, and those of each of its packages that has an `__all__`."""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules
from typing import Any

import tci


def public_names() -> dict[str, list[str]]:
    """The public names of each public package and module."""
    names = [
        "tci",
        "tci.capabilities.behaviour_tree",
        "tci.capabilities.policy",
        *(f"tci.{one.name}" for one in iter_modules(tci.__path__)),
    ]
    found = {name: getattr(import_module(name), "__all__", []) for name in names}
    return {name: sorted(listed) for name, listed in found.items() if listed}


def public_objects() -> dict[str, Any]:
    """What each public name stands for, by its dotted names. Some have two, such as `tci.run` and
    `tci.runtime.run`."""
    return {
        f"{package}.{name}": getattr(import_module(package), name)
        for package, names in public_names().items()
        for name in names
    }
