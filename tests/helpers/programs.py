"""Programs of `tools`, for tests."""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType

from helpers import ROOT


def program(name: str) -> ModuleType:
    """Loads `tools/NAME.py`, anew with each call."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # its dataclasses look there
    spec.loader.exec_module(module)
    return module
