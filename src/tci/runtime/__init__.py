"""The control loop and its watchdogs.

Once per control period, `loop` reads the sensors, runs the capability and writes the checked commands to the
robot. Watchdogs and heartbeat bring the robot to rest after a failure, and `serve` runs the loop for
orders from other programs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.runtime.loop import Tick as Tick
    from tci.runtime.loop import run as run
    from tci.runtime.loop_report import Histogram as Histogram
    from tci.runtime.loop_report import LoopReport as LoopReport
    from tci.runtime.priority import real_time as real_time
    from tci.runtime.result import RunResult as RunResult
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
