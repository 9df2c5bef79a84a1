"""Exports of a robot's model for other libraries.

From a robot's description, the modules compute Denavit-Hartenberg parameters, a URDF, and chains for OROCOS
KDL. `facts` defines the data with which a served robot answers a query.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.exports.chain import ChainSegment as ChainSegment
    from tci.exports.facts import ConeFacts as ConeFacts
    from tci.exports.facts import DHRow as DHRow
    from tci.exports.facts import DHTable as DHTable
    from tci.exports.facts import GenericLimits as GenericLimits
    from tci.exports.facts import PatchFacts as PatchFacts
    from tci.exports.facts import RobotFacts as RobotFacts
    from tci.exports.facts import Taxel as Taxel
    from tci.exports.facts import query as query
    from tci.exports.skin_models import skin_to_mjcf as skin_to_mjcf
    from tci.exports.skin_models import skin_to_urdf as skin_to_urdf
    from tci.exports.tree import Inertia as Inertia
    from tci.exports.tree import KinematicLink as KinematicLink
    from tci.exports.urdf import to_urdf as to_urdf
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
