"""Steps a MuJoCo model, and records whether its poses, contacts and sensors are out of date."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from threading import RLock
from typing import Any, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from tci.messages.frames import Array, transform
from tci.simulation import stepping
from tci.support.engine import mujoco

P = ParamSpec("P")
R = TypeVar("R")


def exclusive(method: Callable[P, R]) -> Callable[P, R]:
    """Wraps a method of an object that has the attribute `_physics`. The method holds the lock of this
    physics until it returns, so that other threads wait.

    MuJoCo's Python module lets other threads run while MuJoCo computes. A step by another thread at this time
    would damage MuJoCo's memory.
    """

    @wraps(method)
    def run(*args: P.args, **named: P.kwargs) -> R:
        with cast(Any, args[0])._physics.lock:
            return method(*args, **named)

    return run


class Physics:
    """A MuJoCo model with its data, advanced in whole steps.

    After a step, MuJoCo's contacts and poses still belong to the joint angles before the step. Call `refresh`
    before you read contacts or poses.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.model = model
        self.data = mujoco.MjData(model)
        self.step = float(model.opt.timestep)
        """Length of a step [s]."""
        self.steps = 0
        """Number of steps since the start or the last reset."""
        self.lock = RLock()
        """Held by a thread that steps the model, calls MuJoCo or reads values that belong together."""
        self._fresh = -1
        data = self.data
        self.qpos, self.qvel, self.ctrl, self.sensors = data.qpos, data.qvel, data.ctrl, data.sensordata
        """MuJoCo's arrays. The references are stored, because a look-up in MuJoCo's data takes longer."""
        self.motors = data.actuator_force
        """Torque [N m] of each actuator in the latest step."""
        weighs = bool(model.ngravcomp) and bool(model.body_gravcomp[1] > 0.0)
        weight = (data.qfrc_gravcomp, data.qfrc_applied) if weighs else (np.zeros(0), np.zeros(0))
        self._moved = self.qpos, self.ctrl, *weight
        self._kept = data.qacc_warmstart, np.zeros(model.nv)
        self._engine = model._address, data._address

    def __reduce__(self) -> Any:
        """Raises TypeError, because a copy would have the addresses of the original's memory."""
        raise TypeError(
            "a simulated world can't be copied or pickled; valid: a new World with equal arguments"
        )

    @property
    def time(self) -> float:
        """Simulated time [s] since the start or the last reset."""
        return self.steps * self.step

    def reset(self, addresses: NDArray[np.intp], angles: Array) -> None:
        """Resets time to 0 and velocities to 0. The joints at `addresses` of `qpos` get `angles` [rad]."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[addresses] = angles
        self.steps = 0
        self.touch()

    def advance(self, until: int, *others: Any) -> None:
        """Executes steps until the total number of steps is `until`.

        `others` are four groups of arrays: of the servos, the finger, the skin and the hands.
        """
        with self.lock:
            self.steps = stepping.march(
                self._engine, self.steps, until, self.step, self._moved, self._kept, *others
            )

    def refresh(self) -> None:
        """Updates poses, contacts and sensors to the current joint angles. Nothing else changes."""
        with self.lock:
            if self._fresh == self.steps:
                return
            # The solver starts from its previous result, and readings contain the torques of the latest step.
            kept = self.data.qacc_warmstart.copy(), self.motors.copy()
            mujoco.mj_forward(self.model, self.data)
            self.data.qacc_warmstart[:], self.motors[:] = kept
            self._fresh = self.steps

    def touch(self) -> None:
        """Marks poses, contacts and sensors as out of date. Call this method after a change of joints or
        servos."""
        with self.lock:
            self._fresh = -1

    def pose(self, body: int) -> Array:
        """Returns `T_WB` (4, 4), the current pose of a body in the world frame."""
        with self.lock:
            self.refresh()
            return transform(self.data.xmat[body].reshape(3, 3), np.array(self.data.xpos[body]))
