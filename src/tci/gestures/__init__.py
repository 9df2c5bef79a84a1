"""Gestures: sequences of postures in generic joints.

Gestures are recorded on a robot, or read from CSV and BVH files. A gesture can be played on any robot.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.gestures.files import read_csv as read_csv
    from tci.gestures.gesture import Fitted as Fitted
    from tci.gestures.gesture import Gesture as Gesture
    from tci.gestures.gesture import fit as fit
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
