"""Calibration of a patch on a robot, from frames at rest and frames under known loads.

The loads are weights that a person puts on the skin, touches of the finger in simulation, or the forces in a
log.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tci.drivers.driver import Driver
from tci.drivers.registry import connect
from tci.drivers.simulated import SimulatedDriver
from tci.errors import CommandError, DriverError, TciError
from tci.lab.authoring.calibrate_force import ForceFit, calibrate_to_force
from tci.lab.authoring.calibrate_skin import Load, calibrate, measured_counts
from tci.lab.authoring.force_log import read_force_log
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.json_file import read_json, write_json
from tci.robot.kinematics import KinematicChain
from tci.robot.skin_files.calibration import (
    PatchCalibration,
    SkinCalibration,
    calibration_path,
)
from tci.runtime.control import Control
from tci.simulation.finger import STIFFNESS
from tci.skin.layout import normal_channels
from tci.skin.surfaces import Surface, build_surface

SILENCE = 5.0
"""Longest time [s] without a frame of the patch; after this time, the calibration ends with DriverError."""
SETTLE = 0.6
"""Time [s] that the simulated finger presses before frames are taken. Assumed: after this time, finger and
arm are at rest."""
PLACES = 4
"""Number of places that the simulated finger presses with each force. The measured force depends on the place
relative to the nearest taxels. Assumed: four places are enough to average this effect out."""


@dataclass(frozen=True)
class PatchMeasurement:
    """Result of the calibration of one patch."""

    file: Path
    """File to which the calibration was written."""
    found: PatchCalibration
    loads: list[dict[str, float]]
    """Three forces [N] for each load: the known force, the force that the skin measured before the
    calibration, and the force that it measures with the calibration."""
    force: ForceFit | None = None
    """Gains of the taxels, fitted to the log of a force sensor, and their errors; None without a log."""


def calibrate_patch(
    robot: Robot,
    patch: str,
    *,
    via: str,
    weights: Sequence[float] = (),
    force_log: Path | None = None,
    frames: int = 200,
    out: Path | None = None,
    ask: Callable[[str], None],
    progress: Callable[[str, int, int], None] = lambda what, done, count: None,
) -> PatchMeasurement:
    """Measures a patch and writes its calibration.

    Args:
        robot: Robot with the patch.
        patch: Name of the patch.
        via: Driver, NAME or NAME:ADDRESS.
        weights: Known loads [N], from light to heavy.
        force_log: Log of forces that were measured during the recording which `via` replays; see
            `read_force_log`. Only one of `weights` and `force_log` may be given.
        frames: Number of frames to take at rest.
        out: File to write, by default beside the description.
        ask: Called with a request to the person beside the robot; returns when the person has done it.
        progress: Called after each frame with its purpose, the number of frames so far, and the number
            wanted.

    Raises CommandError for options that exclude each other, UnknownNameError if the robot has no such patch,
    DriverError if no frames arrive, and TciError for a file that can't be read or written.
    """
    site = robot.patch(patch)
    if weights and force_log is not None:
        raise CommandError("--weight and --force-log exclude each other; valid: one of them")
    for weight in weights:
        if not 0.0 < weight < np.inf:
            raise CommandError(f"--weight {weight} N; valid: above 0 and finite")
    stream = read_force_log(force_log) if force_log is not None else None
    if stream is not None and not via.startswith("replay:"):
        raise CommandError(
            "--force-log needs a recording of the robot made at the same time; valid: --via replay:FILE"
        )
    surface = build_surface(robot, site, KinematicChain(robot))
    target = out or calibration_path(Path(robot.source))
    if not os.access(target if target.exists() else target.absolute().parent, os.W_OK):
        raise CommandError(f"{target} can't be written; valid: --out FILE in a folder that you may write to")
    before = read_json(target, SkinCalibration) if target.is_file() else None
    loads: Sequence[Load] = ()
    force: ForceFit | None = None
    when = datetime.now(UTC).isoformat(timespec="seconds")
    with connect(robot, via, arm=False) as driver:
        session = _LoadSession(driver, patch, normal_channels(site, surface), ask=ask, progress=progress)
        if isinstance(driver, SimulatedDriver):
            driver.world.finger.retire()
        if stream is None:
            session.ask("Take everything off the skin.")
            _, rest = session.take(frames, "at rest")
            loads = list(_pressed(session, surface, weights))
            found = calibrate(site.sensor, surface.areas, rest, loads, when=when)
        else:
            recorded = session.take_all()
            found, force = calibrate_to_force(site.sensor, surface.areas, *recorded, *stream, when=when)
    patches = {} if before is None else dict(before.patches)
    write_json(target, SkinCalibration(robot=robot.name, date=when, patches=patches | {patch: found}))
    rows = [_compare(site.sensor, surface.areas, found, load) for load in loads]
    return PatchMeasurement(target, found, rows, force)


class _LoadSession:
    """Takes frames of one patch from a driver, and asks the person beside the robot for each load."""

    def __init__(
        self,
        driver: Driver,
        patch: str,
        channels: NDArray[np.intp],
        *,
        ask: Callable[[str], None],
        progress: Callable[[str, int, int], None] = lambda what, done, count: None,
    ) -> None:
        """Prepares a session.

        Args: driver: The robot's driver, which is open. patch: Name of the patch. channels: Index (taxels,)
            of each taxel's value in a raw frame; for a three-axis taxel, the index of the value along its
            normal. ask: Called with a request to the person; returns when the person has done it. progress:
            Called after each frame with a text on the purpose of the frames (for example "under 5 N"), the
            number of frames so far, and the number wanted.
        """
        self.driver = driver
        self.patch = patch
        self._channels, self._ask, self._progress = channels, ask, progress
        self._sequence = -1

    def ask(self, words: str) -> None:
        """Makes a request to the person, unless the robot runs in simulation."""
        if not isinstance(self.driver, SimulatedDriver):
            self._ask(words)

    def take(self, count: int, what: str) -> tuple[Array, Array]:
        """Returns stamps (count,) [s] and raw values (count, taxels) of the next frames.

        Raises DriverError if no more frames arrive.
        """
        stamps, values = [], []
        for stamp, frame in self._frames():
            stamps.append(stamp)
            values.append(frame)
            self._progress(what, len(values), count)
            if len(values) == count:
                return np.array(stamps), np.array(values)
        raise DriverError(
            f"{self.patch}: the data ended after {len(values)} frames {what}; valid: {count} frames"
        )

    def take_all(self) -> tuple[Array, Array]:
        """Returns stamps (n,) [s] and raw values (n, taxels) of all frames, to the end of the recording."""
        found = list(self._frames())
        if not found:
            raise DriverError(f"{self.patch}: the recording has no frame of it; valid: a recorded patch")
        stamps, values = zip(*found, strict=True)
        return np.array(stamps), np.array(values)

    def _frames(self) -> Iterator[tuple[float, Array]]:
        last: float | None = None
        for moment in Control(self.driver, write=False).periods():
            now = moment.now
            frame = next((one for one in moment.reading.skin if one.patch == self.patch), None)
            last = now if last is None else last
            if frame is not None and frame.sequence != self._sequence:
                self._sequence, last = frame.sequence, now
                yield frame.stamp, frame.values[self._channels].astype(np.float64)
            elif now - last > SILENCE:
                raise DriverError(
                    f"{self.patch}: no frame for {SILENCE:g} s; see tci doctor {self.driver.robot.name}"
                )


def _pressed(session: _LoadSession, surface: Surface, weights: Sequence[float]) -> Iterator[Load]:
    """Applies known forces one after the other, and yields the frames under each force. On a robot a person
    puts weights on the skin; in simulation the finger presses."""
    driver = session.driver
    generator = np.random.default_rng(0)
    for weight in weights:
        if not isinstance(driver, SimulatedDriver):
            session.ask(
                f"Put {weight:g} N ({weight / 9.81 * 1e3:.0f} g) on the skin, and take your hand away."
            )
            yield Load(weight, session.take(50, f"under {weight:g} N")[1])
            continue
        finger = driver.world.finger
        places = 0
        for taxel in generator.permutation(len(surface.positions)):
            try:
                finger.poke(session.patch, int(taxel), speed=0.1, depth=weight / STIFFNESS)
            except TciError:
                continue  # other links leave no space for the finger
            driver.world.advance(driver.clock.now() + SETTLE)
            felt = session.take(10, f"under {weight:g} N")[1]
            yield Load(driver.world.contact_truth(session.patch).force, felt)
            finger.retire()
            places += 1
            if places == PLACES:
                break


def _compare(sensor: Any, areas: Array, found: PatchCalibration, load: Load) -> dict[str, float]:
    """Returns three forces [N] by name: the known force of `load`, and the force that the skin measures with
    the response in the description and with the calibrated response."""
    counts = np.sign(sensor.pascal_per_count) * (load.values - np.array(found.rest))
    counts = measured_counts(counts, np.array(found.noise))
    after = sensor.model_copy(update={"response": found.response})
    forces = [float((one.pressure(counts) @ areas).mean()) for one in (sensor, after)]
    return {"force_N": load.force, "before_N": forces[0], "after_N": forces[1]}
