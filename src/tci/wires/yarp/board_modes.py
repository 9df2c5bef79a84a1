"""Control modes of YARP, and the corresponding TCI modes of a served joint.

A joint keeps the mode that a client has set. In YARP, the interaction mode (stiff or compliant) is a separate
setting; in TCI, the interaction is part of the mode.
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
"""Control modes of YARP that a client may request, with TCI's mode for each. An idle joint rests and follows
no commands."""
MOVING = (POSITION, MIXED)
"""Control modes in which a joint accepts moves to a target angle."""
USUAL = {Mode.VELOCITY: VELOCITY, Mode.TORQUE: TORQUE}
"""Control mode of YARP that clients read for each mode of TCI, if no client has set the mode. For a mode of
TCI that is not in this table, clients read POSITION."""
STREAMING = {
    Stream.POSITION: (DIRECT,), Stream.VELOCITY: (VELOCITY, VELOCITY_DIRECT), Stream.TORQUE: (TORQUE,),
}  # fmt: skip
"""Control modes in which a joint accepts streamed set-points, by the kind of the set-points."""

JointMode = tuple[Vocab, bool]
"""Control mode of a joint, and True if the joint is compliant."""


class BoardModes:
    """Control and interaction modes that clients have set for the joints of one board."""

    def __init__(self, servos: Sequence[Servo]) -> None:
        """Starts with all joints stiff, in position mode."""
        self._servos = servos
        self._set: list[JointMode] = [(POSITION, False)] * len(servos)

    def word(self, joint: int) -> Vocab:
        """Returns YARP's control mode of a joint."""
        return self._set[joint][0]

    def gate_mode(self, joint: int) -> Mode:
        """Returns the mode in TCI that corresponds to a joint's control and interaction mode in YARP."""
        return _gate_mode(*self._set[joint])

    def available(self, joint: int) -> list[Vocab]:
        """Returns YARP's control modes to which a joint may be switched."""
        return [word for word, mode in MODES.items() if mode in self._servos[joint].modes]

    def catch_up(self, joint: int, mode: Mode) -> None:
        """Stores the `mode` that a joint has in the gate, if another program has changed the mode in the
        gate."""
        if self.gate_mode(joint) is not mode:
            self._set[joint] = USUAL.get(mode, POSITION), mode is Mode.IMPEDANCE

    def shown(self, joint: int, mode: Mode) -> tuple[Vocab, Vocab]:
        """Returns the control and interaction mode that clients read for a joint that is in `mode` at the
        gate."""
        word, soft = self.word(joint), mode is Mode.IMPEDANCE
        if _gate_mode(word, soft) is not mode:
            word = USUAL.get(mode, POSITION)
        return word, COMPLIANT if soft else STIFF

    def need(self, joints: Iterable[int], words: Sequence[Vocab]) -> None:
        """Raises CallError if a joint is in a control mode that is not among `words`."""
        for joint in joints:
            if self.word(joint) not in words:
                raise CallError(
                    f"{self._servos[joint].name} is in {self.word(joint)}; this command needs {words[0]}"
                )

    def with_words(self, joints: Sequence[int], words: Sequence[Vocab]) -> list[JointMode]:
        """Returns the modes that joints (k,) have after a switch to the control modes `words`.

        Raises CallError if a joint can't be switched to the requested mode.
        """
        wanted = [IDLE if word == FORCE_IDLE else word for word in words]
        return self._checked(joints, [(w, self._set[j][1]) for j, w in zip(joints, wanted, strict=True)])

    def with_interactions(self, joints: Sequence[int], words: Sequence[Vocab]) -> list[JointMode]:
        """Returns the modes of joints (k,) after a client has made these joints stiff or compliant.

        Raises CallError if a joint can't be made compliant.
        """
        soft = [word == COMPLIANT for word in words]
        for joint in (joint for joint, yields in zip(joints, soft, strict=True) if yields):
            self._check(joint, Mode.IMPEDANCE)
        return self._checked(joints, [(self.word(j), s) for j, s in zip(joints, soft, strict=True)])

    def changing(self, joints: Sequence[int], wanted: Sequence[JointMode]) -> list[int]:
        """Returns the joints with a mode that differs from the `wanted` mode (k,)."""
        return [joint for joint, one in zip(joints, wanted, strict=True) if self._set[joint] != one]

    def put(self, joints: Sequence[int], wanted: Sequence[JointMode]) -> list[JointMode]:
        """Sets the modes (k,) of joints, and returns their previous modes."""
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
    """Returns TCI's mode for YARP's control mode `word`; `soft` is True for a compliant joint."""
    mode = MODES[word]
    return Mode.IMPEDANCE if mode is Mode.POSITION and soft else mode
