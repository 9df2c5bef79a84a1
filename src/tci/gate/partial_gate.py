"""Gate of a connection that can move only some of the robot's servos."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from tci.gate.gate import Gate, SafeCommand
from tci.gate.immovable import Immovable
from tci.gate.settings import OVER_A_WIRE, GateSettings
from tci.messages import Contacts, JointReading, PlatformOrder
from tci.reasons import Code, Reason
from tci.robot.description import Limits, Robot


class PartialGate(Gate):
    """Gate that refuses commands to servos that a connection can't move, and otherwise works like `Gate`. A
    command to a whole robot part is not refused, but moves only those servos of the part that the connection
    can move.
    """

    def __init__(
        self,
        robot: Robot,
        unreached: Mapping[int, str],
        *,
        period: float,
        stale_after: float,
        streams: bool = False,
        settings: GateSettings = OVER_A_WIRE,
        unwatched: Collection[int] = (),
    ) -> None:
        """Creates the gate, see `Gate`.

        Args:
            robot: The robot.
            unreached: The index of each servo that the connection can't move, with the reason.
            period: See `Gate`, as `stale_after`, `streams` and `settings`.
            unwatched: Those of them whose angles come from elsewhere, a few times a second: a jump of one is
                no fault of an encoder.
        """
        watched = tuple(
            servo.model_copy(update={"limits": servo.limits.model_copy(update={"velocity": None})})
            if servo.index in unwatched
            else servo
            for servo in robot.servos
        )
        super().__init__(
            robot.model_copy(update={"servos": watched}) if unwatched else robot,
            period=period, stale_after=stale_after, settings=settings, streams=streams,
        )  # fmt: skip
        self._unreached = unreached
        servos = tuple(
            servo.model_copy(update={"limits": Limits()}) if servo.index in unreached else servo
            for servo in robot.servos
        )
        self._immovable = Immovable(robot.model_copy(update={"servos": servos}))

    def step(
        self,
        commands: Sequence[PlatformOrder] | PlatformOrder,
        joints: JointReading,
        now: float,
        *,
        refused: Sequence[Reason] = (),
        contacts: Contacts | None = None,
    ) -> SafeCommand:
        kept: list[PlatformOrder] = []
        why = [*refused]
        for command in (commands,) if isinstance(commands, PlatformOrder) else commands:
            left = self._immovable.left_out(command) if isinstance(command, PlatformOrder) else command
            reason = self._refusal(left) if isinstance(left, PlatformOrder) else None
            if reason is None:
                kept.append(left)
            else:
                why.append(reason)
        return super().step(kept, joints, now, refused=why, contacts=contacts)

    def _refusal(self, order: PlatformOrder) -> Reason | None:
        """Returns the reason to refuse an order if it moves a servo that the connection can't move. Otherwise
        returns None."""
        for servo, why in self._unreached.items():
            if servo in order.servos:
                return Reason(Code.ROBOT_REFUSES, f"{self.robot.servos[servo].name} can't be moved: {why}")
        return None
