"""Two programs that make exactly the calls of iCub's public tutorials, tutorial_arm and
tutorial_arm_joint_impedance, as YARP's own clients send them.

The original programs move back and forth without end. These programs end after one move in each direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from helpers.yarp_show import Show, until
from yarpwire.board import COMPLIANT, POSITION, STIFF
from yarpwire.dialect import V3
from yarpwire.rpc import Rpc
from yarpwire.state import BoardState, decode_state
from yarpwire.values import Vocab

FIRST = (-50.0, 20.0, -10.0, 50.0)
THERE, BACK = (-50.0, 20.0, -10.0, 60.0), (-20.0, 40.0, -10.0, 30.0)
ELBOW = 3
TURN = 50
"""Number of readings in each direction, one per 0.1 s."""
WORDS = {
    "getAxesRPC": "get axes", "setTrajAccelerationsAllRPC": "set accs", "setTrajSpeedOneRPC": "set vel",
    "positionMoveAllRPC": "set poss", "checkMotionDoneAllRPC": "get dons",
    "setImpedanceRPC": "set iimp ipr", "setControlModeOneRPC": "set icmd cmod",
    "setInteractionModeOneRPC": "set intm mode",
}  # fmt: skip
"""Words of YARP 3.12 for each method of YARP 4.0."""


class ArmClient:
    """A client of an iCub's right arm. Method calls are sent to the call port; the state is read from
    `stateExt:o`."""

    def __init__(self, show: Show, delay: Callable[[float], None]) -> None:
        self.delay = delay
        self._dialect = show.dialect
        port = "rpc:i" if show.dialect is V3 else "nws/rpc:i"
        self._rpc = Rpc(show.names.query(f"/icub/right_arm/{port}"), "/test/client/rpc:o", show.dialect)
        self._clock = show.driver.clock
        self._state: BoardState | None = None
        self._stamp = -math.inf
        self._port = show.listen("/icub/right_arm/stateExt:o", self._see)

    def _see(self, delivery: Any) -> None:
        self._state = decode_state(delivery.items(self._dialect), self._dialect)
        assert delivery.stamp is not None
        self._stamp = delivery.stamp.time

    def call(self, method: str, *items: Any) -> bool:
        """Calls a method. Returns True if the board executed the call."""
        return self._ask(method, items)[1]

    def get(self, method: str) -> Any:
        """Returns the single value that a method returns."""
        return self._ask(method, ())[0]

    def _ask(self, method: str, items: Sequence[Any]) -> tuple[Any, bool]:
        if self._dialect is not V3:
            said = self._rpc.call(method, *(int(i) if isinstance(i, Vocab) else i for i in items))
            return (said[1] if len(said) > 1 else None), said[0] in (Vocab("ok"), [Vocab("ok")])
        if method == "setImpedanceRPC":
            items = (items[0], [*items[1:]])
        said = self._rpc.call(*map(Vocab, WORDS[method].split()), *items)
        return (said[2] if len(said) > 2 else None), said[-1] == Vocab("ok")

    def encoders(self) -> list[float]:
        """Returns the angles [deg]. Waits for a state that is measured after the call: the served robot moves
        faster than real time, so older states may still be on their way."""
        now = self._clock.now()
        assert until(lambda: self._stamp >= now)
        assert self._state is not None
        return [float(angle) for angle in self._state.position]

    def interaction(self, joint: int) -> int:
        """Returns a joint's interaction mode."""
        assert self._state is not None
        assert self._state.interactions is not None
        return self._state.interactions[joint]

    def close(self) -> None:
        self._port.close()
        self._rpc.close()


def _prepare(arm: ArmClient, *, impedance: bool) -> None:
    count = int(arm.get("getAxesRPC"))
    assert arm.call("setTrajAccelerationsAllRPC", [50.0] * count)
    for joint in range(count):
        assert arm.call("setTrajSpeedOneRPC", joint, 10.0)
        if impedance:
            assert arm.call("setImpedanceRPC", joint, 0.111, 0.014)


def _watch(arm: ArmClient) -> list[float]:
    for _ in range(TURN):
        arm.delay(0.1)
        last = arm.encoders()
    return last


def tutorial_arm(arm: ArmClient) -> Iterator[list[float]]:
    """Yields the angles [deg] at the end of the first move, then at the end of a move in each direction."""
    _prepare(arm, impedance=False)
    command = arm.encoders()
    command[:4] = FIRST
    assert arm.call("positionMoveAllRPC", command)
    while arm.get("checkMotionDoneAllRPC") not in (1, Vocab("ok")):
        arm.delay(0.1)
    yield arm.encoders()
    for goal in (FIRST, BACK):
        command[:4] = goal
        assert arm.call("positionMoveAllRPC", command)
        yield _watch(arm)


def tutorial_arm_joint_impedance(arm: ArmClient) -> Iterator[tuple[list[float], int]]:
    """Yields the angles [deg] and the elbow's interaction mode at the end of a move in each direction."""
    _prepare(arm, impedance=True)
    command = [0.0] * int(arm.get("getAxesRPC"))
    command[:4] = FIRST
    assert arm.call("positionMoveAllRPC", command)
    for mode, goal in ((COMPLIANT, THERE), (STIFF, BACK)):
        assert arm.call("setControlModeOneRPC", ELBOW, POSITION)
        assert arm.call("setInteractionModeOneRPC", ELBOW, mode)
        command[:4] = goal
        assert arm.call("positionMoveAllRPC", command)
        yield _watch(arm), arm.interaction(ELBOW)
