"""Simulated robots with skin, in MuJoCo.

A world contains one robot with its servos and taxels, and a simulated finger that pokes the robot. Drivers
connect to a world as to a real robot.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.simulation.finger import Finger as Finger
    from tci.simulation.hand import Hand as Hand
    from tci.simulation.hand import Person as Person
    from tci.simulation.hand_model import PersonModel as PersonModel
    from tci.simulation.hand_path import HandPath as HandPath
    from tci.simulation.imperfection import Imperfection as Imperfection
    from tci.simulation.obstacle import Obstacle as Obstacle
    from tci.simulation.obstacle import PlacedObstacle as PlacedObstacle
    from tci.simulation.touch import ContactTruth as ContactTruth
    from tci.simulation.touch import Meeting as Meeting
    from tci.simulation.world import World as World
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
