"""Imports MuJoCo, the engine of physics and kinematics; a broken installation raises ClashError with
advice."""

from __future__ import annotations

from tci.errors import ClashError
from tci.support.installed import clash

try:
    import mujoco as mujoco
except (ImportError, OSError) as error:
    found = clash("mujoco")
    if found is None:
        raise
    raise ClashError(f"MuJoCo can't be loaded ({error}): {found.said}; {found.advice}") from error
if not hasattr(mujoco, "MjModel"):
    raise ClashError(
        "MuJoCo's files are missing, as after an uninstallation of MuJoCo 3 beside MuJoCo 4; valid: "
        "pip install --force-reinstall --no-deps 'mujoco-core>=4,<5'"
    )
