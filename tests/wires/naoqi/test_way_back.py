"""A robot that plans its own motion frees whom it presses also if its link is cut after the first order.

The plant shares nothing with the gate (`helpers.rigid_robot`); its joints go to their latest targets at the
share of their top speed that came with them, as ALMotion's do.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from helpers import squeezed
from helpers.rigid_robot import STEP, RigidDriver, RigidRobot
from helpers.squeezed import Squeeze, squeeze
from tci.gate.settings import OVER_A_WIRE, GateSettings
from tci.messages import Mode, Reading
from tci.reasons import Code
from tci.robot.catalogue import load_robot
from tci.wires.naoqi.driver import NaoqiDriver
from tci.wires.naoqi.stream import Stream

NAO = Squeeze(
    "left_arm", np.array([0.59995, 0.37486, -0.75302, 1.03312, 1.23278]),
    np.array([-0.5598, 0.74179, -0.8305, 0.67692, -0.51405]), Mode.POSITION, 0.49, 75e3, "LForeArm",
    np.array([0.0148, 0.02168, 0.026]), np.array([-0.06047, 0.21191, 0.35961]), 500.0, 5,
)  # fmt: skip
ICUB = Squeeze(
    "right_arm", np.array([-0.20589, -0.27135, -0.0707, 1.26154, 0.67578]),
    np.array([0.9769, 1.09587, -0.73067, 1.65281, 0.19206]), Mode.POSITION, 1.0, 75e3, "r_forearm",
    np.array([-0.08182, 0.02362, 0.04512]), np.array([-0.13809, 0.26063, 0.25324]), 100.0, 2,
)  # fmt: skip


class Planning(RigidDriver):
    """The plant behind a NAOqi driver's sender. Its link is cut after the first order of an answer."""

    _send = NaoqiDriver._send

    def __init__(self, plant: RigidRobot, *, settings: GateSettings | None = None) -> None:
        super().__init__(plant, settings=settings or OVER_A_WIRE)
        servos = plant.robot.servos
        names = [servo.name for servo in servos]
        self._number = {name: number for number, name in enumerate(names)}
        self._fastest = np.array([servo.limits.velocity or 1.0 for servo in servos])
        self._stream = Stream(names, np.full(len(names), -9.0), np.full(len(names), 9.0), self._fastest)
        self._generation, self._said = 0, False
        self._poller = SimpleNamespace(
            trouble=None, generation=0, names=names, latest=None, services=SimpleNamespace(motion=self)
        )

    def _receive(self) -> Reading:
        reading = super()._receive()
        self._poller.latest = SimpleNamespace(reading=reading)
        return reading

    def write(self, safe: Any) -> Any:
        met = any(reason.code is Code.CONTACT for reason in safe.clamped)
        sent = super().write(safe)
        if met:
            self._poller.trouble = "cut"
        return sent

    def setAngles(self, names: list[str], angles: list[float], share: float, _async: bool) -> Any:
        plant = self.plant
        for name, angle in zip(names, angles, strict=True):
            servo = self._number[name]
            own = plant._servo == servo
            plant._target[own] = angle * plant._ratio[own] + plant._shift[own]
            plant._stride[own] = share * self._fastest[servo] * np.abs(plant._ratio[own]) * STEP
        return SimpleNamespace(isFinished=lambda: True, hasError=lambda: False)


@pytest.mark.parametrize(
    ("name", "trial"),
    [("nao", NAO), ("nao", replace(NAO, rate=100.0)), ("icub", ICUB)],
    ids=["nao", "nao at 100 Hz", "icub"],
)
def test_a_link_that_is_cut_after_the_first_order_frees(
    name: str, trial: Squeeze, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the set-point of one period as first order 30 N (NAO) and 158 N (iCub) stayed for ever. With
    readings at 100 Hz this NAO meets its person so soon after it was commanded that only some joints went
    back, and 31 N stayed."""
    monkeypatch.setattr(squeezed, "RigidDriver", Planning)
    after = squeeze(load_robot(name), trial)
    assert after.peak > 65.0, "this trial shows nothing"
    assert after.half <= 65.0
    assert after.late <= 15.0
    assert after.over <= 0.2
