"""Registers the environment for `gymnasium.make` without importing Gymnasium.

Gymnasium has no entry points for plugins, and importing Gymnasium would make every `import tci` 0.3 s slower.
If Gymnasium has been imported, the environment is registered at once. Otherwise the environment is registered
when a program imports Gymnasium.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

NAME = "tci/Withdrawal-v0"
"""Name of the environment in Gymnasium's registry."""


def register() -> None:
    """Registers the environment with Gymnasium, once."""
    import gymnasium

    if NAME not in gymnasium.registry:
        gymnasium.register(id=NAME, entry_point="tci.learn.withdrawal_env:WithdrawalEnv")


def register_when_imported() -> None:
    """Registers the environment now if Gymnasium has been imported, else when Gymnasium is imported."""
    if "gymnasium" in sys.modules:
        register()
    else:
        sys.meta_path.insert(0, _Finder())


class _Finder:
    """Import hook that lets the other finders import Gymnasium, and then registers the environment."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != "gymnasium":
            return None
        others = (one.find_spec(name, path, target) for one in sys.meta_path if one is not self)
        spec = next((found for found in others if found is not None), None)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module

            def run_and_register(module: ModuleType) -> None:
                run(module)
                register()

            spec.loader.exec_module = run_and_register  # type: ignore[method-assign]  # on purpose
        return spec
