"""Compacts a closed recording.

The compacted file has zstd compression, an index, and point clouds for display in other programs.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from tci.body.generic_body import GenericBody
from tci.body.perceiver import Perceiver
from tci.errors import RecordingError, TciError
from tci.recording.recording import Recording
from tci.recording.rosmsg.cdr import MessageType, encode
from tci.recording.schemas import CLOUD, JOINTS, SKIN, cloud_fields, header, to_nanoseconds
from tci.recording.topics import Topics
from tci.robot.description import Robot

CLOUDS = 10.0
"""Rate [Hz] of point clouds. Assumed: this is enough for display, as every raw frame is also stored."""
FINEST = 2.0**-13
"""Resolution [m] to which the points of a cloud are rounded (0.12 mm). Rounded points compress better."""

Stamped = tuple[int, str, MessageType, bytes]
"""Time [ns], topic, type and bytes of a message."""


def compact(
    source: Path,
    target: Path,
    *,
    robot: Robot | None = None,
    begin: float = -np.inf,
    end: float = np.inf,
    about: Mapping[str, str] | None = None,
) -> None:
    """Writes a recording again, compressed, from `begin` to `end` [s].

    `target` may be the file `source` itself. Adds point clouds of the skin if the recording's `robot` is
    given and has a model. The latest joints and skin frames before `begin` are repeated at the start of the
    new file. On any error the file `source` stays unchanged. Raises RecordingError if the disk fails or the
    recording can't be read. Raises the errors of `GenericBody` if the robot's model can't be used.
    """
    part = target.with_name(target.name + ".part")
    recording = Recording(source)
    try:
        with part.open("xb") as file:
            writer = Writer(file, enable_data_crcs=True)
            writer.start(profile="ros2", library="tci")
            writer.add_metadata("tci", recording.about | dict(about or {}))
            streams = [_between(recording, begin, end)]
            if robot is not None and robot.model is not None:
                streams.append(_clouds(recording, GenericBody(robot), begin, end))
            topics = Topics(writer)
            for stamp, topic, kind, data in heapq.merge(*streams, key=lambda message: message[0]):
                topics.put(topic, kind, stamp, data)
            topics.finish()
        os.replace(part, target)
    except FileExistsError:
        raise RecordingError(
            f"{part} is in the way: another program packs this recording, or was killed"
        ) from None
    except BaseException as error:
        with suppress(OSError):
            part.unlink()
        if isinstance(error, OSError):
            raise RecordingError(f"{target}: {error.strerror or error}") from error
        raise


def _between(recording: Recording, begin: float, end: float) -> Iterator[Stamped]:
    """Yields the messages of a recording from `begin` to `end` [s].

    The latest joints and skin frames from before `begin` come first, with the time `begin`.
    """
    first = to_nanoseconds(begin) if np.isfinite(begin) else 0
    last = to_nanoseconds(end) if np.isfinite(end) else 2**63
    before: dict[str, Stamped] = {}
    started = False
    for topic, kind, stamp, data in recording.messages():
        if stamp < first:
            if kind in (JOINTS, SKIN):
                before[topic] = (first, topic, kind, data)
        elif stamp < last:
            if not started:
                yield from before.values()
                started = True
            yield stamp, topic, kind, data


def _clouds(recording: Recording, body: GenericBody, begin: float, end: float) -> Iterator[Stamped]:
    """Yields point clouds of the whole skin with its pressure, in the torso frame.

    Skips readings that do not fit the robot.
    """
    due, perceiver = -np.inf, Perceiver(body)
    names = [patch.name for patch in body.robot.patches]
    for tick in recording.ticks():
        if not max(begin, due) <= tick.now < end:
            continue
        try:
            state = perceiver.step(tick.reading, tick.now).skin
            assert state is not None  # a Perceiver always sets `skin`
            pressures = state.by_patch(names)
            points = [body.skin.positions(name, tick.reading.joints, frame="torso") for name in pressures]
        except TciError:
            continue
        if not points:
            continue
        due = tick.now + 1.0 / CLOUDS - 1e-6
        pressure = np.concatenate([*pressures.values()])
        cloud = np.empty((len(pressure), 4), dtype="<f4")
        cloud[:, :3] = np.round(np.concatenate(points) / FINEST) * FINEST
        cloud[:, 3] = pressure
        data = encode(CLOUD, (*header(tick.now, "torso"), *cloud_fields(cloud)))
        yield to_nanoseconds(tick.now), "/skin/points", CLOUD, data
