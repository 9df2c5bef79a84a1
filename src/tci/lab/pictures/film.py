"""Makes an animated picture of a simulated run or of a recording, without a screen."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from PIL import Image, ImageDraw

from tci.capabilities.fields import ReceptiveField, default_fields
from tci.errors import CommandError, RecordingError, UnknownNameError
from tci.lab.pictures.camera import Camera, fit
from tci.lab.pictures.paint import FULL_SCALE, field_looks
from tci.lab.pictures.portrait import Portrait, keep_moment, lowest_shown
from tci.lab.pictures.video import needs_video, save_video
from tci.messages.frames import Array
from tci.recording.perceived import Perceived, perceive, recorded_robot
from tci.recording.recording import Recording
from tci.recording.schemas import to_nanoseconds
from tci.robot.description import Robot
from tci.robot.like import RobotLike
from tci.runtime.loop import Tick
from tci.simulation.hand_model import SIDES, PersonModel
from tci.simulation.world import World

VIDEO = "mp4"
FORMATS = ("gif", "webp", "png", VIDEO)
"""Valid suffixes of the file: three formats of animated pictures, and a video format that needs the extra
`video`."""
# The times, sizes and directions below are chosen by eye.
EVERY = 0.02
"""Time [s] of the simulated run that passes between two pictures of the film."""
SHOWN = 0.06
"""Time [s] for which the film shows each picture. With this time the film plays at a third of real-time
speed."""
LAST = 1.0
"""Time [s] for which the film shows the last picture."""
WIDTH, HEIGHT = 440, 480
AZIMUTH, ELEVATION = 0.5, 0.4
"""Direction [rad] from the robot to the camera."""
HAND = re.compile(rf"tci_(?P<person>\w+)_(?P<side>{'|'.join(SIDES)})_\w+")
"""Name of a pad of a hand."""
MOST = 2000
"""Largest number of pictures in a film."""


class Film:
    """Records a film. Call `see` for every period of the run, and then `save`."""

    def __init__(self, world: World, path: Path, *, fields: Sequence[ReceptiveField], part: str) -> None:
        """Prepares a film of the upper body with the arm `part`, or of the whole body with a leg.

        Raises UnknownNameError for an unknown format, and MissingExtraError for a video if the extra `video`
        is missing. Raises CommandError if the file exists or the folder does not exist.
        """
        self._format = path.suffix.removeprefix(".").lower()
        if self._format not in FORMATS:
            raise UnknownNameError("format of a film", path.suffix.removeprefix("."), FORMATS)
        if self._format == VIDEO:
            needs_video()
        if path.exists():
            raise CommandError(f"{path} exists and is not replaced; valid: a new file name")
        if not path.parent.is_dir():
            raise CommandError(f"{path.parent} is no folder; valid: a folder that exists")
        self.path, self._part = path, part
        self._world = world
        self._portrait = Portrait(world, field_looks(fields), full_scale=FULL_SCALE)
        self._camera: Camera | None = None
        self._due = -np.inf
        self._pictures: list[Image.Image] = []

    def see(self, tick: Tick | Perceived, touching: Mapping[str, Array] = MappingProxyType({})) -> None:
        """Adds a picture to the film if EVERY [s] have passed since the last picture. A recorded period must
        be shown in the world before (`World.show`), and `touching` is what touched the robot in it
        (`Recording.touching`)."""
        if tick.now < self._due or len(self._pictures) >= MOST:
            return
        self._due = tick.now + EVERY - 1e-9
        moment = keep_moment(self._world, tick.reading)
        self._world.show_touching(moment.data, touching)
        if self._camera is None:
            lowest = lowest_shown(self._world.robot, self._part, 0.7)
            points = self._portrait.outline(moment, part=self._part, lowest=lowest)
            self._camera = fit(
                points, azimuth=AZIMUTH, elevation=ELEVATION, width=WIDTH, height=HEIGHT, margin=0.08,
                frame=self._portrait.torso(moment),
            )  # fmt: skip
        picture = Image.fromarray(self._portrait.draw(moment, self._camera))
        words = f"{tick.now:.2f} s"
        felt = tick.perception.contacts
        force = sum(contact.force for contact in felt if contact.patch not in self._world.robot.switches)
        if force > 0.0:
            words += f"   {force:.1f} N"
        elif len(felt):
            words += "   pressed"
        ImageDraw.Draw(picture).text((10, HEIGHT - 26), words, fill=(29, 39, 51), font_size=16)
        self._pictures.append(picture)

    def save(self) -> int:
        """Writes the file and returns the number of pictures. Raises CommandError if the film has no
        pictures."""
        if not self._pictures:
            raise CommandError(f"no film at {self.path}: the run had no period; valid: a longer run")
        if self._format == VIDEO:
            save_video(self.path, self._pictures, shown=SHOWN, last=LAST)
            return len(self._pictures)
        times = [round(1e3 * SHOWN)] * len(self._pictures)
        times[-1] = round(1e3 * LAST)
        pictures: list[Image.Image] = self._pictures
        if self._format == "gif":
            # All pictures share one palette, as their colours would otherwise flicker.
            palette = self._pictures[len(self._pictures) // 2].quantize(256)
            pictures = [
                picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in self._pictures
            ]
        pictures[0].save(self.path, save_all=True, append_images=pictures[1:], duration=times, loop=0)
        return len(pictures)


def film(
    recording: Recording | Path | str,
    out: Path | str,
    *,
    robot: RobotLike | None = None,
    part: str | None = None,
    begin: float = -np.inf,
    end: float = np.inf,
) -> int:
    """Films a recording at a third of its speed: the robot's posture, the pressure on its skin, and what
    touched it. Returns the number of pictures.

    What touched a real robot is not known, so it is not drawn. A picture takes one to three seconds.

    Args:
        recording: recording, or its file.
        out: new file, .gif, .webp, .png or .mp4 (needs the extra `video`).
        robot: the robot, if the recording was made with a description file.
        part: generic part to show; by default the one that was touched first.
        begin: from this time of the recording on [s].
        end: up to this time [s].

    Raises RecordingError for a recording without a robot's name or without periods in this time, and the
    errors of `Film` and `Recording`.
    """
    recording = recording if isinstance(recording, Recording) else Recording(recording)
    found = recorded_robot(recording, robot)
    if found is None:
        raise RecordingError(f"{recording.path} does not name its robot; valid: with the robot's name")
    periods = [one for one in perceive(recording, found) if begin <= one.now <= end]
    if not periods:
        first, last = recording.span()
        raise RecordingError(
            f"{recording.path} has nothing from {begin} to {end} s; valid: within {first:.3f} to {last:.3f} s"
        )
    touched = (contact.part for one in periods for contact in one.perception.contacts)
    shown = found.part(part or next(touched, found.parts[0].name)).name
    world, truth = world_of(recording, found)
    made = Film(world, Path(out), fields=default_fields(), part=shown)
    for one in periods:
        world.show(one.reading.joints.position)
        made.see(one, truth.get(to_nanoseconds(one.now), {}))
    return made.save()


def world_of(recording: Recording, robot: Robot) -> tuple[World, dict[int, dict[str, Array]]]:
    """A world with those who touched the robot of a recording, and their poses by time [ns]. Raises
    RecordingError for damaged data."""
    truth = dict(recording.touching())
    people = _people_of({name for poses in truth.values() for name in poses})
    return World(robot, people=people), truth


def _people_of(bodies: Iterable[str]) -> list[PersonModel]:
    """Those who have pads with these names (`World.touching`)."""
    hands: dict[str, set[str]] = {}
    for body in bodies:
        if found := HAND.fullmatch(body):
            hands.setdefault(found["person"], set()).add(found["side"])
    return [PersonModel(name=name, hands=sorted(sides)) for name, sides in hands.items()]
