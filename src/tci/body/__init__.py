"""The generic body of one robot: readings become perceptions, generic commands become joint commands.

The generic body also has methods for geometry: the place of a contact, the displacement of a contact by a
motion, and the stability of the robot. Landmarks define corresponding places on the bodies of all robots.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.body.cartesian import Reach as Reach
    from tci.body.gaze import Look as Look
    from tci.body.generic_body import BodySettings as BodySettings
    from tci.body.generic_body import GenericBody as GenericBody
    from tci.body.meeting import first_peak as first_peak
    from tci.body.pace import Pace as Pace
    from tci.body.perceiver import Perceiver as Perceiver
    from tci.body.places import Place as Place
    from tci.body.tactile import ContactShape as ContactShape
    from tci.body.tactile import PressureImage as PressureImage
    from tci.body.tactile import ShearForce as ShearForce
    from tci.body.tactile import TouchEvent as TouchEvent
    from tci.body.tactile import contact_shape as contact_shape
    from tci.body.tactile import pressure_image as pressure_image
    from tci.body.tactile import shear_force as shear_force
    from tci.body.tactile import touch_events as touch_events
    from tci.robot.blow import PEOPLE as PEOPLE
    from tci.robot.blow import Struck as Struck
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
