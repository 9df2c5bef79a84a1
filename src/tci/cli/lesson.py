"""A motion that was taught by touch, as a gesture: `tci run teach ROBOT --lesson FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tci.errors import CommandError

if TYPE_CHECKING:
    from tci.gestures.gesture import Gesture
    from tci.robot.description import Robot


def expect_lesson(capability: object, path: Path) -> None:
    """Raises CommandError if `capability` can't be taught, or if `path` can't hold a gesture. Called before
    anybody teaches, so that no motion is lost."""
    from tci.capabilities.arbiter import Arbiter
    from tci.capabilities.teach.capability import Teach
    from tci.cli.gesture import writable

    layers = capability.layers if isinstance(capability, Arbiter) else (capability,)
    if not any(isinstance(layer, Teach) for layer in layers):
        raise CommandError(
            "--lesson is what was taught by touch; valid: tci run teach ROBOT --lesson FILE, or companion"
        )
    writable(path)


def save_lesson(memory: Any, robot: Robot, path: Path) -> Gesture | None:
    """Writes the motion that was taught last, with its corrections. None: no lesson was ended."""
    from tci.body.generic_body import GenericBody
    from tci.capabilities.companion import taught_in
    from tci.gestures.files import write_csv

    motion = taught_in(memory)
    if motion is None:
        return None
    gesture = motion.gesture(GenericBody(robot))
    write_csv(gesture, path, {part.name: [joint.name for joint in part.servos] for part in robot.parts})
    return gesture
