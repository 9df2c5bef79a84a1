"""Makes worlds with one of the engines."""

from __future__ import annotations

from typing import Any, Literal, get_args, overload

from tci.batch.cpu import MujocoWorlds
from tci.batch.scene import batch_scene
from tci.batch.worlds import Engine, Worlds
from tci.errors import UnknownNameError
from tci.robot.like import RobotLike


@overload
def make_worlds(
    robot: RobotLike,
    count: int,
    *,
    engine: Literal["mujoco"] = "mujoco",
    threads: int = 0,
    device: str | None = None,
    skin: bool = True,
    **world: Any,
) -> MujocoWorlds: ...
@overload
def make_worlds(
    robot: RobotLike,
    count: int,
    *,
    engine: Engine,
    threads: int = 0,
    device: str | None = None,
    skin: bool = True,
    **world: Any,
) -> Worlds: ...
def make_worlds(
    robot: RobotLike,
    count: int,
    *,
    engine: Engine = "mujoco",
    threads: int = 0,
    device: str | None = None,
    skin: bool = True,
    **world: Any,
) -> Worlds:
    """`count` worlds of a robot, stepped together.

    Args:
        robot: The robot.
        count: Number of worlds.
        engine: "mujoco" on processors, in double precision; "warp" on a GPU, in single precision (extra
            `batch`).
        threads: Threads of the physics on processors; 0 for one each.
        device: Warp's name of a GPU, such as "cuda:1"; by default the first one.
        skin: False leaves taxels and contacts out; the physics stays the same.
        world: Of `World`: `step`, `posture`, `tip`, `period`.

    Raises TciError for what batches do not have, see `batch_scene`, and the errors of `World`;
    UnknownNameError for another engine, MissingExtraError without mujoco-warp.
    """
    if engine not in get_args(Engine):
        raise UnknownNameError("engine", engine, get_args(Engine))
    scene = batch_scene(robot, **world)
    if engine == "mujoco":
        return MujocoWorlds(scene, count, threads=threads, skin=skin)
    from tci.batch.gpu import WarpWorlds  # loads Warp

    return WarpWorlds(scene, count, device=device, skin=skin)
