"""What carries the base of one arm: a table, a wall or a ceiling, a fixed body that it must not hit."""

from __future__ import annotations

import numpy as np

from tci.messages.frames import Array, apply, read_only
from tci.robot.description import Model
from tci.robot.neutral import neutral
from tci.support.engine import mujoco

OUTWARD = {
    "table": read_only([0.0, 0.0, 1.0]), "wall": read_only([1.0, 0.0, 0.0]),
    "ceiling": read_only([0.0, 0.0, -1.0]),
}  # fmt: skip
"""Directions (3,) from what carries an arm to the arm, in the torso frame."""
SIZE = (1.0, 1.0, 0.05)
"""Half of the body's extents [m]: wider than arms reach."""


def add_mounting(spec: mujoco.MjSpec, model: Model, *, group: int) -> None:
    """Adds what carries the base, if the description says it, as a body of its own that is fixed to the torso
    link, with its shape in a `group` of geoms. So a message about it says `table`."""
    if model.stands_on is None:
        return
    outward = OUTWARD[model.stands_on]
    depth = abs(outward) * model.stands_at - SIZE[2] * outward
    pose, turned, quaternion = model.T_LT, np.empty(9), np.empty(4)
    turned[:] = (pose[:3, :3] @ _turn_to(outward)).ravel()
    mujoco.mju_mat2Quat(quaternion, turned)
    body = spec.body(model.torso_link).add_body(
        name=model.stands_on, pos=apply(pose, depth), quat=quaternion, mass=0.0
    )
    body.add_geom(
        neutral(spec), name=f"tci_{model.stands_on}", type=mujoco.mjtGeom.mjGEOM_BOX, size=SIZE, mass=0.0,
        contype=1, conaffinity=1, group=group,
    )  # fmt: skip


def _turn_to(axis: Array) -> Array:
    """A rotation (3, 3) that turns z to `axis`, one of the frame's own."""
    x = np.roll(axis, 1)
    return np.column_stack([x, np.cross(axis, x), axis])
