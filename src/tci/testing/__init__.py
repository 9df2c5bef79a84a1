"""Help for tests of capabilities and drivers: robots without hardware and without a simulation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.testing.fake_driver import FakeDriver as FakeDriver
    from tci.testing.touched_robot import PERIOD as PERIOD
    from tci.testing.touched_robot import TouchedRobot as TouchedRobot
    from tci.testing.touched_robot import perception as perception
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
