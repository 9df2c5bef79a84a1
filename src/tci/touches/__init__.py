"""Touches of people as data: kinds, places in plain words, persons, and sequences of touches in a file.

A `Touch` is what somebody does; `plan` says where each pad of the hand is at each time on the skin of one
robot, and with what force; `LaidTouches` turns this into pressure on taxels, without physics.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.touches.events import read_touches as read_touches
    from tci.touches.events import write_touches as write_touches
    from tci.touches.kinds import KINDS as KINDS
    from tci.touches.kinds import Kind as Kind
    from tci.touches.kinds import read_kinds as read_kinds
    from tci.touches.laid import LaidTouches as LaidTouches
    from tci.touches.observed import observe as observe
    from tci.touches.person import Person as Person
    from tci.touches.places import Spot as Spot
    from tci.touches.places import find_spot as find_spot
    from tci.touches.places import place_words as place_words
    from tci.touches.planned_touch import PlannedTouch as PlannedTouch
    from tci.touches.planned_touch import plan as plan
    from tci.touches.touch import Touch as Touch
    from tci.touches.touch import parse_touch as parse_touch
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
