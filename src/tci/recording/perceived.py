"""Computes the perceptions of a recording again from its raw frames, period by period."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import FrameError, RecordingError, UnknownNameError
from tci.messages import Perception, Reading, SkinState
from tci.recording.recording import Recording
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot


@dataclass(frozen=True, slots=True, eq=False)
class Perceived:
    """One recorded period, with the perception that was computed for this period."""

    now: float
    """Time [s] on the driver's clock."""
    reading: Reading
    """Reading of the robot."""
    perception: Perception
    """Posture and contacts. If `reading` does not fit the robot, posture and contacts are those of the last
    period with a fitting reading."""
    commands: tuple[dict[str, Any], ...]
    """Commands of the behaviour. Each command has the keys `kind`, `part`, `mode`, `values`, `point`,
    `nearest` and `servos`."""
    decision: dict[str, Any] | None
    """The gate's decision in this period, with the fields of `schemas.DECISION`. The value is None if nothing
    was sent to the robot."""

    @property
    def skin(self) -> SkinState:
        """Pressure on the whole skin."""
        assert self.perception.skin is not None  # a Perceiver always sets `skin`
        return self.perception.skin


def recorded_robot(recording: Recording, robot: RobotLike | None = None) -> Robot | None:
    """Returns the robot of a recording.

    If `robot` is None, the recorded name is used. Returns None if the recording contains no name of a robot.
    Raises RecordingError if the robot's description differs from the recorded one.
    """
    name = recording.about.get("robot", "")
    if not name:
        return None
    if robot is None and not name.replace("_", "").replace("-", "").isalnum():
        raise RecordingError(f"{recording.path} names the robot {name[:40]!r}; give its description as ROBOT")
    try:
        found = as_robot(robot or name)
    except UnknownNameError:
        if robot is not None:
            raise
        raise RecordingError(
            f"{recording.path} was recorded from {name!r}, which is no robot of TCI; give the path of its "
            "description (.xml) after the recording"
        ) from None
    digest = recording.about.get("description_sha256", "")
    if found.digest != digest:
        raise RecordingError(
            f"{recording.path} was recorded with another description of {name!r} ({digest[:12]}; "
            f"here {found.digest[:12]}); give the description of that time as ROBOT"
        )
    return found


def perceive(recording: Recording, robot: Robot) -> Iterator[Perceived]:
    """Yields every recorded period with the perception of `robot`. Raises RecordingError if the recording
    can't be read."""
    perceiver = Perceiver(GenericBody(robot), keep_alive=recording.keep_alive)
    perception: Perception | None = None
    for tick in recording.ticks():
        try:
            perception = perceiver.step(tick.reading, tick.now)
        except FrameError:
            if perception is None:
                continue
        yield Perceived(tick.now, tick.reading, perception, tick.commands, tick.decision)
