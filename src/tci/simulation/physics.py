"""A MuJoCo model in motion, and whether what is derived from its joints is up to date."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from tci.frames import Array, transform


class Physics:
    """A model with its data, stepped in whole steps.

    After a step MuJoCo's contacts and poses still belong to the joints before it. Whoever reads them
    calls `refresh` first.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.step = float(model.opt.timestep)
        """Length of a step [s]."""
        self.steps = 0
        """Steps since the start."""
        self._fresh = -1

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.steps * self.step

    def reset(self, addresses: NDArray[np.intp], angles: Array) -> None:
        """Back to time 0, at rest, with the joints at `addresses` of `qpos` at `angles` [rad]."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[addresses] = angles
        self.steps = 0
        self._fresh = -1

    def advance(self) -> None:
        """One step."""
        mujoco.mj_step(self.model, self.data)
        self.steps += 1

    def refresh(self) -> None:
        """Make poses, contacts and sensors belong to the present joints. Nothing else changes."""
        if self._fresh == self.steps:
            return
        # The solver starts from its last result: looking must not change what happens next.
        warm = self.data.qacc_warmstart.copy()
        mujoco.mj_forward(self.model, self.data)
        self.data.qacc_warmstart[:] = warm
        self._fresh = self.steps

    def touch(self) -> None:
        """Say that joints were moved from outside: what is derived from them is out of date."""
        self._fresh = -1

    def pose(self, body: int) -> Array:
        """`T_WB` (4, 4) of a body in the world, now."""
        self.refresh()
        return transform(self.data.xmat[body].reshape(3, 3), np.array(self.data.xpos[body]))
