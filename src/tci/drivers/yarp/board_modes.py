"""Control modes of YARP, and the corresponding TCI modes of a served joint.

A joint keeps the mode that a client has set. In YARP the interaction (stiff or compliant) is a separate
setting; in TCI it is part of the mode.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tci.messages import Mode
from tci.robot.description import Servo
from yarpwire.board import (
    COMPLIANT,
    DIRECT,
    FORCE_IDLE,
    IDLE,
    MIXED,
    POSITION,
    STIFF,
    TORQUE,
    VELOCITY,
    VELOCITY_DIRECT,
    Stream,
)
from yarpwire.errors import CallError
from yarpwire.values import Vocab

MODES = {
    POSITION: Mode.POSITION, DIRECT: Mode.POSITION, MIXED: Mode.POSITION, IDLE: Mode.POSITION,
    FORCE_IDLE: Mode.POSITION, VELOCITY: Mode.VELOCITY, VELOCITY_DIRECT: Mode.VELOCITY, TORQUE: Mode.TORQUE,
}  # fmt: skip
"""Control modes that a client may ask for, and TCI's mode of each. An idle joint rests and follows no
command."""
MOVING = (POSITION, MIXED)
"""Control modes that take moves."""
USUAL = {Mode.VELOCITY: VELOCITY, Mode.TORQUE: TORQUE}
"""Control mode to show for each of TCI's modes that no client has asked for; else POSITION."""
STREAMING = {
    Stream.POSITION: (DIRECT,), Stream.VELOCITY: (VELOCITY, VELOCITY_DIRECT), Stream.TORQUE: (TORQUE,),
}  # fmt: skip
"""Control modes that take each kind of set-points."""

JointMode = tuple[Vocab, bool]
"""Control mode of a joint, and True if it is compliant."""


class BoardModes:
    """Control and interaction modes that clients have set for the joints of one board."""

    def __init__(self, servos: Sequence[Servo]) -> None:
        """Starts with all joints stiff, in position mode."""
        self._servos = servos
        self._set: list[JointMode] = [(POSITION, False)] * len(servos)

    def word(self, joint: int) -> Vocab:
        """Returns the control mode of a joint."""
        return self._set[joint][0]

    def gate_mode(self, joint: int) -> Mode:
        """Returns TCI's mode of a joint."""
        return _gate_mode(*self._set[joint])

    def available(self, joint: int) -> list[Vocab]:
        """Returns the control modes that a joint may be switched to."""
        return [word for word, mode in MODES.items() if mode in self._servos[joint].modes]

    def catch_up(self, joint: int, mode: Mode) -> None:
        """Adopts a mode that another program has set at the gate."""
        if self.gate_mode(joint) is not mode:
            self._set[joint] = USUAL.get(mode, POSITION), mode is Mode.IMPEDANCE

    def shown(self, joint: int, mode: Mode) -> tuple[Vocab, Vocab]:
        """Returns the control and interaction mode to show for a joint that is in `mode` at the gate."""
        word, soft = self.word(joint), mode is Mode.IMPEDANCE
        if _gate_mode(word, soft) is not mode:
            word = USUAL.get(mode, POSITION)
        return word, COMPLIANT if soft else STIFF

    def need(self, joints: Iterable[int], words: Sequence[Vocab]) -> None:
        """Raises CallError unless all joints are in one of these control modes."""
        for joint in joints:
            if self.word(joint) not in words:
                raise CallError(
                    f"{self._servos[joint].name} is in {self.word(joint)}; this command needs {words[0]}"
                )

    def with_words(self, joints: Sequence[int], words: Sequence[Vocab]) -> list[JointMode]:
        """Returns the modes of joints (k,) in these control modes. Raises CallError for one that a joint does
        not have."""
        wanted = [IDLE if word == FORCE_IDLE else word for word in words]
        return self._checked(joints, [(w, self._set[j][1]) for j, w in zip(joints, wanted, strict=True)])

    def with_interactions(self, joints: Sequence[int], words: Sequence[Vocab]) -> list[JointMode]:
        """Returns the modes of joints (k,) that are made stiff or compliant. Raises CallError for a joint
        that can't yield."""
        soft = [word == COMPLIANT for word in words]
        for joint in (joint for joint, yields in zip(joints, soft, strict=True) if yields):
            self._check(joint, Mode.IMPEDANCE)
        return self._checked(joints, [(self.word(j), s) for j, s in zip(joints, soft, strict=True)])

    def changing(self, joints: Sequence[int], wanted: Sequence[JointMode]) -> list[int]:
        """Returns the joints that are in another mode than the wanted one (k,)."""
        return [joint for joint, one in zip(joints, wanted, strict=True) if self._set[joint] != one]

    def put(self, joints: Sequence[int], wanted: Sequence[JointMode]) -> list[JointMode]:
        """Sets the modes (k,) of joints, and returns those from before."""
        before = [self._set[joint] for joint in joints]
        for joint, one in zip(joints, wanted, strict=True):
            self._set[joint] = one
        return before

    def _checked(self, joints: Sequence[int], wanted: list[JointMode]) -> list[JointMode]:
        for joint, one in zip(joints, wanted, strict=True):
            self._check(joint, _gate_mode(*one))
        return wanted

    def _check(self, joint: int, mode: Mode) -> None:
        servo = self._servos[joint]
        if mode not in servo.modes:
            valid = ", ".join(known.value for known in servo.modes)
            raise CallError(f"{servo.name} has no {mode.value} mode; valid: {valid}")


def _gate_mode(word: Vocab, soft: bool) -> Mode:
    """Returns TCI's mode of a joint in a control mode, stiff or `soft`."""
    mode = MODES[word]
    return Mode.IMPEDANCE if mode is Mode.POSITION and soft else mode
