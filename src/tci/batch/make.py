"""Makes worlds with one of the engines."""

from __future__ import annotations

from typing import Any

from tci.batch.cpu import MujocoWorlds
from tci.batch.scene import BatchScene, batch_scene
from tci.robot.like import RobotLike


def make_worlds(robot: RobotLike | BatchScene, count: int, *, threads: int = 0, **world: Any) -> MujocoWorlds:
    """`count` worlds of a robot, stepped together.

    Args:
        robot: The robot, or a scene that was made before.
        count: Number of worlds.
        threads: Threads of the physics; 0 for one per processor.
        world: Of `World`: `step`, `posture`, `tip`, `period`.

    Raises TciError for what batches do not have, see `batch_scene`, and the errors of `World`.
    """
    scene = robot if isinstance(robot, BatchScene) else batch_scene(robot, **world)
    return MujocoWorlds(scene, count, threads=threads)
