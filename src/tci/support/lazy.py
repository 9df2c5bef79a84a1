"""Packages whose public names are loaded when they are first used, so that importing a package costs nothing.

Such a package states each name once, in the form that type checkers read:

    if TYPE_CHECKING:
        from tci.gate.gate import Gate as Gate
    else:
        __all__, __getattr__, __dir__ = lazy_names(__name__)
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

LINE = re.compile(r"^    from (\S+) import (\w+) as \2$", re.MULTILINE)


def lazy_names(package: str) -> tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]:
    """`__all__`, `__getattr__` and `__dir__` of a package, from the imports in its source."""
    module = sys.modules[package]
    assert module.__file__
    with open(module.__file__, encoding="utf-8") as source:
        homes = {name: home for home, name in LINE.findall(source.read())}

    def load(name: str) -> Any:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(homes[name]), name)
        setattr(module, name, value)
        return value

    return [*homes], load, lambda: sorted(homes)
