"""A MuJoCo model in motion, and whether what is derived from its joints is up to date."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.engine import mujoco
from tci.frames import Array, transform
from tci.simulation import stepping


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
        data = self.data
        self.qpos, self.qvel, self.ctrl, self.sensors = data.qpos, data.qvel, data.ctrl, data.sensordata
        """MuJoCo's own arrays: looking them up anew takes longer than reading them."""
        self.motors = data.actuator_force
        """Torque [N m] of each actuator in the latest step."""
        self._warm = data.qacc_warmstart
        self._moved = self.qpos, self.qvel, self.ctrl, data.qfrc_applied, data.xfrc_applied.reshape(-1)
        self._here = np.zeros(sum(one.size for one in self._moved) + model.nv)
        self.whole = np.zeros(4, dtype=np.int64)
        """Whole numbers of the loop; places as `stepping` names them."""

    @property
    def time(self) -> float:
        """Time since the start [s]."""
        return self.steps * self.step

    def reset(self, addresses: NDArray[np.intp], angles: Array) -> None:
        """Back to time 0, at rest, with the joints at `addresses` of `qpos` at `angles` [rad]."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[addresses] = angles
        self.steps = 0
        self.touch()

    def advance(self, until: int, *others: Any) -> None:
        """Steps until there were `until` of them since the start. `others` are the arrays of servos, finger
        and taxels as `stepping.march` takes them."""
        self.steps = stepping.march(
            self.model._address, self.data._address, self.steps, until, self.step, self._moved, self._warm,
            self._here, self.whole, *others,
        )  # fmt: skip

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
        """Say that joints were moved, or servos changed: what is derived from them is out of date."""
        self._fresh = self.whole[stepping.AHEAD] = -1

    def pose(self, body: int) -> Array:
        """`T_WB` (4, 4) of a body in the world, now."""
        self.refresh()
        return transform(self.data.xmat[body].reshape(3, 3), np.array(self.data.xpos[body]))
