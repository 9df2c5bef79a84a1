"""Tools around the core: describe a robot, try a real one, experiments, faults, pictures, the viewer.

Programs need only the names below; each is loaded when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.lab.commissioning.doctor import judge as judge
    from tci.lab.commissioning.streams import Observation as Observation
    from tci.lab.commissioning.streams import Stream as Stream
    from tci.lab.commissioning.streams import observe as observe
    from tci.lab.experiments.follow import Following as Following
    from tci.lab.experiments.follow import follow as follow
    from tci.lab.experiments.simulate import WorldRun as WorldRun
    from tci.lab.experiments.simulate import simulate as simulate
    from tci.lab.pictures.pressure_png import write_png as write_png
    from tci.lab.sweeps.sweep import Shard as Shard
    from tci.lab.sweeps.sweep import Sweep as Sweep
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
