"""Detection of touches through joint torques, for example on limbs without skin.

An observer computes the external torques on the joints, and an estimator computes the point and the force of
a touch that would cause these torques. Touches that skin also measures keep the position from the skin, and
get a better force from the joint torques.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.joint_touch.contacts import JointTouchSettings as JointTouchSettings
    from tci.joint_touch.observer import ObserverSettings as ObserverSettings
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
