"""Control loops and their watchdogs.

`Control` is one period: it reads the robot, and sends orders through the gate. On it are built `run`, for
a capability, `Stepper`, for callers with a pace of their own, and `serve`, for the orders of other programs.
Watchdogs and heartbeat bring the robot to rest after a failure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.runtime.control import Control as Control
    from tci.runtime.loop import Tick as Tick
    from tci.runtime.loop import run as run
    from tci.runtime.loop_report import Histogram as Histogram
    from tci.runtime.loop_report import LoopReport as LoopReport
    from tci.runtime.moment import Moment as Moment
    from tci.runtime.priority import real_time as real_time
    from tci.runtime.result import RunResult as RunResult
    from tci.runtime.stepper import Stepper as Stepper
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
