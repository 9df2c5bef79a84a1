"""Environments for learning (extra `gym`).

Importing this package registers the ready tasks: `gymnasium.make("tci.learn:tci/Withdrawal-v0")`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.installed import needs
from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.learn.named_env import NamedEnv as NamedEnv
    from tci.learn.named_robot import NamedRobot as NamedRobot
    from tci.learn.task import Scene as Scene
    from tci.learn.task import TouchTask as TouchTask
    from tci.learn.tasks import HOLD as HOLD
    from tci.learn.tasks import REACH as REACH
    from tci.learn.tasks import TASKS as TASKS
    from tci.learn.tasks import WITHDRAWAL as WITHDRAWAL
    from tci.learn.touch_env import Camera as Camera
    from tci.learn.touch_env import TouchEnv as TouchEnv
    from tci.learn.touch_vector_env import TouchVectorEnv as TouchVectorEnv
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)

with needs("the environments of tci.learn", "gym"):
    import gymnasium

for _name in ("withdrawal", "hold", "reach"):
    gymnasium.register(
        id=f"tci/{_name.title()}-v0",
        entry_point=f"{__name__}.touch_env:TouchEnv",
        vector_entry_point=f"{__name__}.touch_vector_env:TouchVectorEnv" if _name == "withdrawal" else None,
        kwargs={"task": _name},
    )
gymnasium.register(
    id="tci/Named-v0", entry_point=f"{__name__}.named_env:NamedEnv", order_enforce=False
)  # LeRobot looks for names that wrappers hide
