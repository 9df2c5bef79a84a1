"""Tasks that are ready: withdraw from a touch, hold a touch at a force, reach through poles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tci.body.generic_body import GenericBody
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.capabilities.capability import Capability
from tci.capabilities.finger_reflex.capability import FingerReflex
from tci.capabilities.policy.observations import View
from tci.capabilities.policy.spec import PolicySpec
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.errors import TciError
from tci.learn.reach import REACH as REACH
from tci.learn.task import Poke, Scene, TouchTask
from tci.messages import Command, GenericCommand, Mode, Perception, SwitchMode
from tci.messages.frames import read_only

PAIN = 400e3
"""Pressure [Pa] that counts as pain. Assumed: the order of magnitude that algometers measure on arms. Behrens
et al. 2022 (doi:10.3389/frobt.2021.667818) list thresholds for several points of the body and several
tools."""
EFFORT, AWAY = 0.05, 0.5
"""Weights of motion and of the distance from the initial posture in `withdrawal_reward`; that of harm is 1.
Assumed: at twice the weight of AWAY, who stands still and suffers loses less than the reflex does on NAO."""


def withdrawal_reward(view: View, *, pain: float = PAIN) -> dict[str, float]:
    """`harm` is the largest pressure on the part divided by `pain` [Pa], `effort` 0.05 times the mean square
    of the generic velocities [rad2/s2], `away` 0.5 times the mean distance of the joints from `home` [rad].
    """
    skin, speed = view.perception.skin, (view.posture - view.before) / max(view.elapsed, 1e-9)
    own = [p for p, patch in enumerate(view.body.robot.patches) if patch.part == view.part]
    harm = max((float(skin.on(p).max(initial=0.0)) for p in own), default=0.0) if skin is not None else 0.0
    return {
        "harm": -harm / pain,
        "effort": -EFFORT * float(speed @ speed) / len(speed),
        "away": -AWAY * float(np.abs(view.posture - view.home).mean()),
    }


def felt(view: View) -> float:
    """Force [N] of all contacts on the part."""
    return float(sum(contact.force for contact in view.perception.contacts if contact.part == view.part))


def hold_reward(view: View) -> dict[str, float]:
    """`error` is the distance of the felt force from the asked one, divided by the asked one, at most 2."""
    (wanted,) = view.goal
    return {"error": -min(abs(felt(view) - wanted) / wanted, 2.0)}


@dataclass(frozen=True)
class HoldTouch(Capability[None]):
    """Keeps the force of a touch on a part at `force`: yields to more, comes back for less (admittance
    control, Hogan 1985). Raises TciError for a number out of range."""

    part: str
    force: float = 3.0
    """[N]"""
    mobility: float = 0.4
    """Velocity for each torque that is too much [rad/s per N m]. At six times this, the delay of a skin at
    50 Hz makes an arm swing on a finger of 800 N/m."""

    def __post_init__(self) -> None:
        for name in ("force", "mobility"):
            if not 0.0 < getattr(self, name) < np.inf:
                raise TciError(f"hold a touch: {name} {getattr(self, name)}; valid: above 0, finite")

    def init(self, body: GenericBody) -> None:
        return None

    def begin(self, perception: Perception, body: GenericBody) -> tuple[Command, ...]:
        return (SwitchMode(self.part, Mode.VELOCITY),)

    def step(
        self, memory: None, perception: Perception, body: GenericBody
    ) -> tuple[tuple[Command, ...], None]:
        torque = np.zeros(len(perception.posture[self.part]))
        own = [one for one in perception.contacts if one.part == self.part]
        total = sum(one.force for one in own)
        for one in own:
            torque += body.jacobian(perception, one).T @ one.f_T * (1.0 - self.force / total)
        return (GenericCommand(self.part, Mode.VELOCITY, read_only(self.mobility * torque)),), None

    def claims(self, memory: None) -> frozenset[str]:
        return frozenset({self.part})


def _reflex(scene: Scene) -> Capability[Any]:
    match scene.robot.part(scene.part).kind:
        case "arm":
            return WithdrawalReflex()
        case "fingers":
            return FingerReflex()
        case _:
            return BodyWithdrawal()


WITHDRAWAL = TouchTask(
    reward=withdrawal_reward,
    baseline=_reflex,
    policy=PolicySpec(action_scale=(1.2,) * 5),
    success=lambda view: felt(view) == 0.0,
)
"""A finger pokes the part; withdraw from it, move little, and come back. The baseline is the reflex of such
parts. Success: nothing is felt any more."""

FORCES = (2.0, 5.0)
HELD = 0.25
"""Share of the asked force by which a touch that is held may differ from it. Assumed."""


def _force(scene: Scene) -> ArrayLike:
    """Draws the force [N] to hold."""
    return [scene.chance.uniform(*FORCES)]


def _holds(view: View) -> bool:
    (wanted,) = view.goal
    return bool(abs(felt(view) - wanted) <= HELD * wanted)


def _hold(scene: Scene) -> HoldTouch:
    return HoldTouch(scene.part, float(scene.goal[0]))


HOLD = TouchTask(
    reward=hold_reward,
    baseline=_hold,
    touch=Poke(depth=(0.009, 0.015)),
    goal=_force,
    policy=PolicySpec(
        observations=("offset", "velocity", "contacts", "goal"), mode="velocity", action_scale=(1.0,) * 5
    ),
    success=_holds,
    duration=3.0,
)
"""A finger presses with 7 to 12 N; keep the touch at the asked force of 2 to 5 N by yielding. The goal is the
force [N]. Success: it is within a quarter of it."""

TASKS: Mapping[str, TouchTask] = MappingProxyType({"withdrawal": WITHDRAWAL, "hold": HOLD, "reach": REACH})
"""The ready tasks, by the name that `TouchEnv` takes."""
