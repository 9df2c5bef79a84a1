"""What answers a touch in the demo, by what a robot can feel with, and how a trial shows that it answered."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.capability import Capability
from tci.capabilities.contact_stop import HEAD_STOP
from tci.capabilities.finger_reflex.capability import FingerReflex
from tci.capabilities.soft_hands import HANDS, OF_A_HAND, SoftHands
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.poke import Trace
from tci.messages import Perception
from tci.messages.frames import Array
from tci.robot.description import Patch, Robot
from tci.robot.generic_fingers import FINGERS, FLEXIONS, PALM
from tci.robot.joint_map import joint_map
from tci.robot.like import as_robot

AWAY = 1.0
"""Least displacement [mm] of the skin along its inward normal that counts as a withdrawal. The displacement
is measured relative to the trial without reflex. Assumed: servos that only yield to the finger move the skin
by less."""
CLOSED = 0.1
"""Least angle [rad] by which a touched palm closes its fingers within a trial, in the mean of those it has;
fingers that only yield to the poke move by less."""
STANDS, SWAYS = np.deg2rad([0.5, 3.0])
"""Largest motion [rad] of arms that stand still, and least motion of arms that sway on: 3 degrees take a
quarter of a second."""
BRAKES = 0.2
"""Time [s] from the first contact in which arms come to rest."""

Parts = frozenset[str]


class Still(Capability[None]):
    """Does nothing, whatever is touched."""

    def init(self, body: GenericBody) -> None:
        return None

    def step(self, memory: None, perception: Perception, body: GenericBody) -> tuple[tuple[()], None]:
        return (), None


@dataclass(frozen=True, eq=False)
class Answer:
    """A capability that answers touches of some skin."""

    name: str
    """Of the capability, as `tci run` takes it."""
    capability: Capability[Any]
    without: Capability[Any]
    """The same robot that does not feel."""
    shown: Callable[[Robot, str, Trace, Trace], bool]
    """Whether a poke of a part was answered, from the traces with and without it."""
    moves: Callable[[Robot, str], Parts] = lambda robot, part: frozenset({part})
    """The parts that a touch of a part makes it command; others may not be commanded."""
    moves_before: bool = False
    """True if it also moves them untouched."""
    led: bool = False
    """True if the finger already moves the joints when the first command comes."""
    weak: bool = False
    """True if a finger may push its joints beyond their limits while they are commanded: they yield to it."""
    posture: Callable[[Robot], Mapping[str, Array]] = field(default=lambda robot: {})
    """How the robot stands before the poke: generic angles [rad] by part."""


def withdrawal(reflex: WithdrawalReflex) -> Answer:
    return Answer("withdrawal", reflex, replace(reflex, fields=()), _goes_away)


def answer_of(patch: Patch, robot: Robot) -> Answer | None:
    """What answers a touch of finger pads and switches; None for other skin, and where nothing does."""
    part = robot.part(patch.part)
    if part.kind == "fingers" and not patch.sensor.switch and patch.segment in (*FINGERS, PALM):
        return HOLDS if patch.segment == PALM else LETS_GO
    if not patch.sensor.switch:
        return None
    if part.kind == "head":
        return STOPS
    if part.kind in HANDS and patch.segment in OF_A_HAND:
        return LED
    return None


def _commanded(trace: Trace) -> Parts:
    return frozenset(part for _, part in trace.commanded)


def withdrawn(trace: Trace) -> float:
    """How far [mm] the poked skin went along its inward normal."""
    return (trace.away[-1] - trace.away[0]) * 1e3


def _goes_away(robot: Robot, part: str, acted: Trace, held: Trace) -> bool:
    return _commanded(acted) == {part} and withdrawn(acted) - withdrawn(held) >= AWAY


def _closes(robot: Robot, part: str, acted: Trace, held: Trace) -> bool:
    own = joint_map(robot, part)
    flexions = [joint for joint in FLEXIONS if joint in own.ids]

    def bend(trace: Trace) -> float:
        begun, ended = (own.to_generic(trace.positions[k])[flexions] for k in (0, -1))
        return float((ended - begun).mean())

    return _commanded(acted) == {part} and bend(acted) - bend(held) >= CLOSED


def _stands(robot: Robot, part: str, acted: Trace, held: Trace) -> bool:
    arms = [servo.servo for name in _arms(robot, part) for servo in robot.part(name).servos]
    servos = [servo for servo in arms if servo is not None]

    def way(trace: Trace) -> float:
        late = np.array(trace.time) >= (acted.first_contact or np.inf) - acted.start + trace.start + BRAKES
        path = np.array(trace.positions)[late][:, servos]
        return float(np.ptp(path, axis=0).max()) if len(path) else np.inf

    stood = bool(way(acted) <= STANDS and way(held) >= SWAYS)
    return stood and _commanded(acted) == _arms(robot, part)


def _led(robot: Robot, part: str, acted: Trace, held: Trace) -> bool:
    return _commanded(acted) <= {part} and withdrawn(acted) - withdrawn(held) >= AWAY


def _arms(robot: Robot, part: str) -> Parts:
    return frozenset(one.name for one in robot.parts if one.kind == "arm")


def _relaxed(robot: Robot) -> dict[str, Array]:
    body = GenericBody(as_robot(robot))
    return {part: FingerReflex().relaxed(part, body) for part in body.parts("fingers")}


LETS_GO = Answer("finger-reflex", FingerReflex(), Still(), _goes_away, weak=True, posture=_relaxed)
HOLDS = replace(LETS_GO, shown=_closes)
STOPS = Answer("head-stop", HEAD_STOP, HEAD_STOP.inner, _stands, _arms, moves_before=True)
LED = Answer("soft-hands", SoftHands(), Still(), _led, led=True, weak=True)
