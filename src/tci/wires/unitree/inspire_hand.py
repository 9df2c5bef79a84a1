"""Reads Inspire RH56DFTP hands from the topics of the maker's bridge: angles become servos, pads become skin.

A servo belongs to the joint with its name in Unitree's model, such as `left_index_1_joint`, or in its address
`left:index`. A patch belongs to the pad with its name, such as `left_index_tip`, or in its address
`left:index_tip`.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.diagnosis import Finding, Level
from tci.drivers.remote.source_clock import SourceClock
from tci.errors import DriverError, FrameError
from tci.messages import SkinFrame
from tci.messages.frames import Array, read_only
from tci.robot.description import Robot
from tci.robot.tactile_devices import hand_joints
from tci.shared.inspire_dds import DEVICE, FULL, PADS, STATE, TOUCH, pads_in, state_in, topic
from tci.shared.interface_node import InterfaceNode, latest
from tci.wires.unitree.motors import INSPIRE, SIDES, inspire_joint

OVERDUE = 2.0
"""Multiple of the usual time between two states after which nobody knows where the fingers are, so that the
robot's joint data counts as old."""
EARLY = 0.5
"""Share of `stale_after` in the binding at which a hold tells whose state is missing: before the gate finds
the joint data too old, which can't tell."""
FORGETS = 0.1
"""Share by which a shorter time between two states counts; a longer one counts at once."""
LONGEST = 0.1
"""Longest usual time [s] between two states. The rate of the bridge is published nowhere. Assumed: it reads a
hand at least ten times a second."""
ERRORS = ("stall", "heat", "current", "motor", "communication")
"""Bits of `err`, by Inspire's manual PRJ-02-TS-U-001."""


def joints_of(robot: Robot, side: str) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices (k,) of the servos of one Inspire hand, and the places (k,) of their joints in its messages."""
    order = [*INSPIRE.values()]
    found = [
        (servo.index, order.index(joint[1]))
        for servo in robot.servos
        if (joint := inspire_joint(robot, servo.name)) is not None and joint[0] == side
    ]
    servos, places = np.array(found, dtype=np.intp).reshape(-1, 2).T
    return servos, places


def inspire_pads(robot: Robot, side: str) -> dict[str, str]:
    """The pad of each patch on one Inspire hand. Raises DriverError if a patch has not its pad's channels."""
    binding, found = robot.binding("unitree"), {}
    has = any(inspire_joint(robot, servo.name) for servo in robot.servos)
    for patch in robot.patches:
        usual = patch.name.replace("_", ":", 1) if has else ""
        to = re.fullmatch(rf"{side}:([a-z_]+)", binding.address(patch.name, usual))
        if patch.through_joints or to is None or to[1] not in PADS:
            continue
        if patch.channels != PADS[to[1]]:
            raise DriverError(
                f"{patch.name} has {patch.channels} channels; valid: {PADS[to[1]]}, as {to[1]} of an Inspire "
                "hand"
            )
        found[patch.name] = to[1]
    return found


def radians(places: NDArray[np.intp], values: Array) -> Array:
    """Angles (k,) [rad] of the joints at `places` (k,), from the `values` (k,) of a message."""
    joints = hand_joints(DEVICE)
    pairs = zip(places.tolist(), values.tolist(), strict=True)
    return np.array([joints[place].angle(value / FULL) for place, value in pairs])


def counts(places: NDArray[np.intp], angles: Array) -> NDArray[np.int16]:
    """Values (k,) for a message, 0 to `FULL`, from the angles (k,) [rad] of the joints at `places` (k,)."""
    joints = hand_joints(DEVICE)
    pairs = zip(places.tolist(), angles.tolist(), strict=True)
    return np.array([round(FULL * joints[place].share(angle)) for place, angle in pairs], np.int16)


class InspireHand:
    """Reader of one hand's state and touch."""

    def __init__(
        self, robot: Robot, side: str, node: InterfaceNode, *, skin: bool = True, felt: frozenset[str]
    ) -> None:
        """Opens readers if the robot has joints or, with `skin`, patches of an Inspire hand on this side.
        Patches that are `felt` by sources are left out.

        Raises DriverError if a patch has not as many channels as its pad.
        """
        self.side, self.topic, self.commands = side, topic("state", side), topic("ctrl", side)
        self._patience = EARLY * robot.binding("unitree").stale_after
        self.servos, self.places = joints_of(robot, side)
        """Indices (k,) of the servos, and places (k,) of their joints in messages."""
        pads = inspire_pads(robot, side)
        self.beside = bool(felt & pads.keys())
        """True if a source feels this hand, so that the robot can be read without the bridge."""
        self.given_up = False
        """True if nobody waits for its angles any more."""
        self._pads = {name: pad for name, pad in pads.items() if name not in felt} if skin else {}
        self.there = bool(len(self.servos) or self._pads)
        """True if the robot's description has joints or patches on this hand."""
        self.state: Any = None
        """Latest values (6,) of the angles, 0 to `FULL`; None before the first state."""
        self.stamp = -np.inf
        """Time [s] of the latest state."""
        self.late = True
        """True if the angles were too old when messages were read last."""
        self.fault = ""
        """Reason for which the fingers must not move until a person connects again."""
        self.frames: tuple[SkinFrame, ...] = ()
        """Latest frame of each patch; empty before the first message of touch."""
        self._torn = self._touches = 0
        self._source, self._touched = SourceClock(), SourceClock()
        self._gap, self._arrival = LONGEST, -np.inf
        self._from = self._to = np.zeros(len(self.servos))
        if self.there:
            other = next(one for one in SIDES if one != side)
            self._states = node.reader(self.topic, STATE)
            self._touch = node.reader(topic("touch", side), TOUCH)
            self._other = node.reader(topic("state", other), STATE)

    @property
    def heard(self) -> bool:
        """True as soon as the angles are known."""
        return self.state is not None or not len(self.servos)

    @property
    def missing(self) -> str:
        """Why the angles are not known, and what to do."""
        said = f"no state of the {self.side} hand"
        if self._torn:
            return f"{said} that can be used ({self._torn} were not): see whether the hand has power"
        if latest(self._other):
            return f"{said}, but of the other one; the maker's bridge calls a single hand r: start it with LR"
        return f"{said}; start the maker's bridge on the robot's computer"

    def overdue(self, now: float) -> bool:
        """True if the angles are too old for a new joint reading."""
        return len(self.servos) > 0 and not self.given_up and now - self.stamp > OVERDUE * self._gap

    def silent(self, now: float) -> str:
        """Why the robot must hold at `now` [s]; empty if the hand's state is fresh."""
        age = now - self.stamp
        if self.state is None or not self.overdue(now - self._patience):
            return ""
        return f"joint data is {1e3 * age:.0f} ms old: no state of the {self.side} hand, topic {self.topic}"

    def poll(self, now: float) -> None:
        """Reads the latest messages of the hand; `now` [s] is the present time."""
        if not self.there:
            return
        for sample in () if self.given_up else latest(self._states):
            stamp = self._source.place(sample.sample_info.source_timestamp * 1e-9, now)
            try:
                state = state_in(sample.raw)
            except FrameError:
                self._torn += 1
                continue
            if stamp is not None:
                self._see(state, min(stamp, now), now)
        self.late = self.overdue(now)
        for sample in latest(self._touch) if self._pads else ():
            stamp = self._touched.place(sample.sample_info.source_timestamp * 1e-9, now)
            try:
                pads = pads_in(sample.raw)
            except FrameError:
                self._torn += 1
                continue
            if stamp is not None:
                self._touches += 1
                self.frames = tuple(
                    SkinFrame(name, min(stamp, now), self._touches, read_only(pads[pad], np.float32))
                    for name, pad in self._pads.items()
                )

    def _see(self, state: dict[str, Any], stamp: float, now: float) -> None:
        angles = radians(self.places, state["angle_act"][self.places])
        if self.state is None or self.overdue(now):
            self._from = angles
        else:
            self._from, _ = self._angles(now)
        if self.state is not None:
            gap = min(max(stamp - self.stamp, 1e-3), LONGEST)
            self._gap = max(gap, self._gap + FORGETS * (gap - self._gap))
        self._to, self._arrival = angles, now
        self.state, self.stamp = state["angle_act"], stamp
        wrong = np.flatnonzero(state["err"][self.places])
        if wrong.size and not self.fault:
            place = self.places[wrong[0]]
            bits = int(state["err"][place])
            words = [word for bit, word in enumerate(ERRORS) if bits & 1 << bit] or [f"error {bits}"]
            self.fault = (
                f"{self.side} {[*INSPIRE.values()][place]} of the Inspire hand reports {', '.join(words)}"
            )

    def _angles(self, now: float) -> tuple[Array, Array]:
        """Angles (k,) [rad] and speeds (k,) [rad/s] at `now` [s]. A hand sends its state more seldom than the
        robot, and a step from one state to the next would look like an encoder that jumps; so the angles
        glide to a new state in the usual time between two."""
        share = (now - self._arrival) / self._gap
        way = self._to - self._from
        if share >= 1.0:
            return self._to, np.zeros(len(way))
        return self._from + max(share, 0.0) * way, way / self._gap

    def fill(self, position: Array, velocity: Array, torque: Array, now: float) -> None:
        """Writes the joints' angles [rad] and speeds [rad/s] at `now` [s] into the arrays (n_servos,). The
        hand measures forces at its tendons, but no torques."""
        if self.state is None:
            position[self.servos] = velocity[self.servos] = 0.0
        else:
            position[self.servos], velocity[self.servos] = self._angles(now)
        torque[self.servos] = np.nan

    def diagnose(self, now: float) -> Finding:
        """Whether this hand's topics arrive."""
        subject = f"{self.side} hand"
        if self.state is None and len(self.servos):
            return Finding(Level.WARNING, subject, f"{self.missing}: its fingers can't be moved")
        if why := self.silent(now):
            return Finding(Level.FAULT, subject, why, "see whether the maker's bridge still runs")
        if self._pads and not self.frames:
            words = f"its angles arrive, but nothing on {topic('touch', self.side)}"
            return Finding(Level.WARNING, subject, words, "start the maker's bridge with touch")
        torn = f"; {self._torn} messages could not be used" if self._torn else ""
        felt = f", and {len(self.frames)} pads" if self.frames else ""
        return Finding(
            Level.WARNING if torn else Level.OK,
            subject, f"{len(self.servos)} angles arrive{felt}{torn}",
            "the bridge sends zeros where reading the hand failed" if torn else "",
        )  # fmt: skip
