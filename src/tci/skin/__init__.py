"""Perception of touch: turns raw frames into pressure on taxels, and pressure into contacts.

Conditioning estimates each taxel's rest value and noise and turns raw values into pressure. Neighbouring
active taxels are combined to contacts with a place on the generic limb, and compiled loops (`kernels/`) track
these contacts over time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.skin.baseline import BaselineSettings as BaselineSettings
    from tci.skin.conditioning import ConditioningSettings as ConditioningSettings
    from tci.skin.conditioning import PatchHealth as PatchHealth
    from tci.skin.contacts import ContactSettings as ContactSettings
    from tci.skin.health import HealthSettings as HealthSettings
    from tci.skin.isolated import IsolatedSettings as IsolatedSettings
    from tci.skin.kernels.arrays import Estimates as Estimates
    from tci.skin.layout import SkinLayout as SkinLayout
    from tci.skin.layout import SkinPatch as SkinPatch
    from tci.skin.skin import Skin as Skin
    from tci.skin.surfaces import Surface as Surface
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
