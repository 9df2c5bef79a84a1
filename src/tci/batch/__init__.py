"""Many worlds with skin, stepped together: on processors by `mujoco.batch`, on a GPU by mujoco-warp.

`make_worlds` makes them. `formulas` and the loops of one world (`tci.simulation`, `tci.skin`) are what both
engines compute.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tci.support.lazy import lazy_names

if TYPE_CHECKING:
    from tci.batch.answers import Answers as Answers
    from tci.batch.cpu import MujocoWorlds as MujocoWorlds
    from tci.batch.imperfect import Imperfections as Imperfections
    from tci.batch.imperfect import ImperfectSkin as ImperfectSkin
    from tci.batch.make import make_worlds as make_worlds
    from tci.batch.scene import BatchScene as BatchScene
    from tci.batch.scene import batch_scene as batch_scene
    from tci.batch.skin_file import skin_to_json as skin_to_json
    from tci.batch.worlds import Worlds as Worlds
else:
    __all__, __getattr__, __dir__ = lazy_names(__name__)
