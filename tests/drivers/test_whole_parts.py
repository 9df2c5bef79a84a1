"""Joints without a command, for a controller that needs set-points for all joints of a part: these joints
stay at their angles and never jump."""

from __future__ import annotations

import numpy as np
import pytest

from helpers.gate_checks import Driven, make_robot, position_command
from tci.drivers.remote.whole_parts import WholeParts
from tci.errors import DriverError
from tci.messages import Mode, PlatformCommand


def test_a_joint_that_nobody_commands_stays_where_it_was_at_first() -> None:
    driven, parts = Driven(make_robot(), [0.1 * i for i in range(6)]), WholeParts(make_robot())
    safe = driven.step(position_command([1], [0.5]))
    assert parts.complete(safe, driven.angles)["arm"] == pytest.approx(
        [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], abs=1e-4
    )
    sagged = driven.angles - 0.02
    for _ in range(50):
        told = parts.complete(driven.step(), sagged)["arm"]
    assert told[:1] + told[2:] == pytest.approx([0.0, 0.2, 0.3, 0.4, 0.5])
    assert told[1] > 0.11


@pytest.mark.parametrize("commanded", [[1], [0, 1]], ids=["the same", "another one too"])
@pytest.mark.parametrize("at_rest", [0, 5], ids=["at once", "later"])
def test_a_joint_that_was_moved_by_hand_does_not_jump_back(at_rest: int, commanded: list[int]) -> None:
    """After an operator's reset no joint is commanded. In an earlier version this joint was sent back by 34
    degrees in one period."""
    driven, parts = Driven(make_robot(coupled=False), [0.0] * 6), WholeParts(make_robot())

    def step(*commands: PlatformCommand) -> dict[str, list[float]]:
        return parts.complete(driven.step(*commands), driven.angles)

    step(position_command(commanded, [0.4] * len(commanded)))
    for _ in range(500):
        step()
    driven.gate.stop("an operator's stop")
    for _ in range(100):
        step()
    driven.gate.reset()
    driven.angles[[0, 5]] += 0.6  # moved by hand
    for _ in range(at_rest):
        assert step() == {}
    told = step(position_command([1], [0.5]))
    assert told["arm"][0] == pytest.approx(0.6 + (0.4 if 0 in commanded else 0.0))
    assert told["arm"][5] == pytest.approx(0.6)


def test_a_robot_that_was_away_stays_where_it_is_then() -> None:
    driven, parts = Driven(make_robot(), [0.0] * 6), WholeParts(make_robot())
    parts.complete(driven.step(position_command([1], [0.5])), driven.angles)
    parts.forget()
    assert parts.complete(driven.step(), driven.angles + 0.3)["arm"][5] == pytest.approx(0.3)


def test_only_positions_are_taken() -> None:
    robot = make_robot(modes=(Mode.VELOCITY,))
    driven = Driven(robot, [0.0] * 6)
    safe = driven.step(PlatformCommand(Mode.VELOCITY, np.array([1]), np.array([0.1]), np.array([np.inf])))
    with pytest.raises(DriverError, match="joint1 is in velocity mode; this robot takes: position"):
        WholeParts(robot).complete(safe, driven.angles)
