"""What can be taught on a robot, and how it is touched and led."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tci.body import GenericBody
from tci.capabilities.limbs import limbs
from tci.capabilities.needs import Need
from tci.capabilities.teach.taps import Touching
from tci.messages import Mode
from tci.messages.frames import Array, read_only

CARRIED = ("hand", "fingers")
"""Kinds of parts that an arm carries."""


@dataclass(frozen=True, slots=True, eq=False)
class Limb:
    """A part that can be led."""

    patches: frozenset[str]
    """Skin whose touch leads it: its own, and for an arm that of its hand and fingers, where it moves."""
    soft: bool
    """Its skin is switches that don't tell how hard they are pressed: it gets soft while it is held."""
    rates: Array
    """Its speeds (n,) [rad/s] while it is guided."""
    before: Array
    """Where it was (n,) [rad] when the present touch began."""
    touch: Touching = field(default_factory=Touching)
    rest: Array | None = None
    """Where it stays (n,) [rad]; None while it is not ours."""
    yields: bool = False
    """It has only switches, and is soft now."""
    let_go: bool = False
    """It was pressed too hard, so that it is not ours until nobody touches it."""

    @property
    def touched(self) -> bool:
        return self.touch.touched and not self.let_go


def limbs_of(body: GenericBody) -> dict[str, Limb]:
    """All parts of a robot that can be led, by name: arms with skin or with skin on what they carry, fingers
    with skin that no arm carries, and arms and heads with switches."""
    found, able = {}, limbs(body)
    for part in body.robot.parts:
        if part.name not in able and (part.kind != "head" or not body.has_joint(part.name).any()):
            continue
        parts = {part.name}
        if part.kind == "arm":
            parts |= {one.name for one in body.robot.parts if one.kind in CARRIED and one.side == part.side}
        carried = body.carried(part.name)
        skin = [patch for patch in Need("", tuple(parts)).skin_of(body.robot) if patch.name in carried]
        soft = all(patch.sensor.switch for patch in skin)
        if not skin or (part.kind == "head" and not soft):
            continue
        needed = Mode.IMPEDANCE if soft else Mode.VELOCITY
        if all(needed in body.robot.servos[k].modes for k in body.joint_maps[part.name].servos):
            rates = read_only(np.zeros(len(part.servos)))
            found[part.name] = Limb(frozenset(patch.name for patch in skin), soft, rates, rates)
    return found
