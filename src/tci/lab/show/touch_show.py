"""The show on simulated robots, one after the other, as fast as the machine goes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tci.body.generic_body import GenericBody
from tci.capabilities.companion import Companion, taught_in
from tci.drivers.registry import connect
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError
from tci.gestures.files import write_csv
from tci.gestures.gesture import Gesture
from tci.lab.show.acts import ACTS, CAST, Act
from tci.lab.viewer.labels import without_numbers
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run
from tci.touches.places import NoSkinError, find_spot
from tci.touches.touch import parse_touch

WORLD: Mapping[str, Any] = {"people": 2, "self_touch": False, "step": 0.002, "rate": 100.0}
"""Worlds of the show, as the viewer's: two people, since a hand needs time to come back."""
Watch = Callable[[Robot, Act, Tick, SimulatedDriver], None]


@dataclass(frozen=True, slots=True)
class Scene:
    """What one robot did in one act."""

    robot: str
    act: str
    felt: float
    """Greatest force [N] of a contact."""
    moved: Mapping[str, float]
    """By how much each part moved [deg], where that is a degree or more: its joint that moved most."""
    said: tuple[tuple[float, str], ...]
    """What it said, and when [s]."""


@dataclass(slots=True)
class TouchShow:
    """The show; `play` goes through it once."""

    robots: Sequence[Robot]
    file: Path
    """Where what the first robot is taught is written, as a gesture; an older lesson is replaced."""
    lesson: Gesture | None = None
    scenes: list[Scene] = field(default_factory=list)

    def play(
        self,
        acts: Sequence[Act] = ACTS,
        *,
        watch: Watch | None = None,
        progress: Callable[[str], None] = print,
    ) -> None:
        """Plays acts. Raises CommandError if the first robot was to be taught and was not, and the errors of
        `World.touch` for a robot without skin at the places of the show."""
        for act in acts:
            for robot in self.robots[:1] if act.teaches else self.robots:
                progress(f"{robot.name}: {act.words}")
                self.scenes.append(self._scene(robot, act, watch))

    def _scene(self, robot: Robot, act: Act, watch: Watch | None) -> Scene:
        companion = Companion(gesture=self.lesson if act.repeats else None)
        said: dict[str, tuple[float, str]] = {}
        felt, postures = [0.0], list[Mapping[str, Array]]()
        with connect(robot, "sim", **WORLD) as driver:
            assert isinstance(driver, SimulatedDriver)

            def observe(tick: Tick) -> None:
                felt.append(max((one.force for one in tick.perception.contacts), default=0.0))
                postures.append(tick.perception.posture)
                if watch is not None:
                    watch(robot, act, tick, driver)

            def listen(memory: Any) -> bool:
                for note in companion.notes(memory):
                    said.setdefault(without_numbers(note), (driver.world.time, note))
                return False

            driver.world.touch(act.on(robot))
            result = run(driver, companion, duration=act.lasts, observe=observe, until=listen)
        if act.teaches:
            self.lesson = taught(result.memory, robot, self.file)
        return Scene(robot.name, act.name, max(felt), _moved(postures), tuple(said.values()))


def check_cast(robots: Sequence[Robot]) -> None:
    """Raises CommandError if the show touches one of the robots where it has no skin."""
    for number, robot in enumerate(robots):
        body = GenericBody(robot)
        for act in ACTS if number == 0 else [act for act in ACTS if not act.teaches]:
            for touch in map(parse_touch, act.on(robot)):
                try:
                    find_spot(body, touch.place)
                except NoSkinError:
                    raise CommandError(
                        f"{robot.name} can't be in the show: it has no skin on {touch.place!r}, where people "
                        f"touch it; valid: robots with skin on both forearms, and {', '.join(CAST)}"
                    ) from None


def taught(memory: Any, robot: Robot, file: Path) -> Gesture:
    """What a companion was taught, also written to a file. Raises CommandError if it was taught nothing."""
    motion = taught_in(memory)
    if motion is None:
        raise CommandError(
            f"{robot.name} was taught nothing; valid: skin on the left forearm, and room there"
        )
    gesture = motion.gesture(GenericBody(robot))
    file.unlink(missing_ok=True)
    write_csv(gesture, file, {part.name: [joint.name for joint in part.servos] for part in robot.parts})
    return gesture


def _moved(postures: Sequence[Mapping[str, Array]]) -> dict[str, float]:
    found = {}
    for part in postures[0]:
        way = float(np.degrees(np.ptp([one[part] for one in postures], axis=0).max(initial=0.0)))
        if way >= 1.0:
            found[part] = round(way, 1)
    return found
