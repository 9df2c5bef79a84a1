"""Help for tests of capabilities and drivers: robots without hardware and without a simulation."""

from __future__ import annotations

from tci.testing.touched_robot import PERIOD, TouchedRobot, perception

__all__ = ["PERIOD", "TouchedRobot", "perception"]
