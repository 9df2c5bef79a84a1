"""A skin patch for long runs, with noise, drift that is nearly equal for all taxels, and touches. Frames are
processed in blocks."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from helpers.flat_skin import OnePatch, skin_patch
from tci.robot.description import Sensor
from tci.robot.skin_files.calibration import PatchCalibration

ROWS, COLUMNS = 12, 20
TAXELS = ROWS * COLUMNS
PASCAL = 450.0
RATE = 50.0


def grid() -> np.ndarray:
    """Returns pairs of neighbouring taxels in a grid of 12 x 20, in which each taxel has up to four
    neighbours."""
    index = np.arange(TAXELS).reshape(ROWS, COLUMNS)
    across = np.stack([index[:, :-1].ravel(), index[:, 1:].ravel()], axis=1)
    down = np.stack([index[:-1].ravel(), index[1:].ravel()], axis=1)
    return np.concatenate([across, down])


def sensor(bits: int = 8) -> Sensor:
    """Returns a sensor whose values decrease with pressure, with a rest value at 15/16 of its range."""
    highest = 2.0**bits - 1
    return Sensor(
        rest=round(0.94 * highest),
        pascal_per_count=-PASCAL * 255.0 / highest,
        lowest=0.0,
        highest=highest,
    )


def conditioner(
    of: Sensor | None = None, *, calibration: PatchCalibration | None = None, segment: str = "forearm"
) -> OnePatch:
    """Returns the conditioner of a patch of 240 taxels."""
    patch = skin_patch(
        of or sensor(), np.arange(TAXELS), neighbours=grid(), rate=RATE, calibration=calibration,
        segment=segment,
    )  # fmt: skip
    return OnePatch(patch)


def bump(row: float, column: float, peak: float, *, width: float = 1.3) -> np.ndarray:
    """Returns the signal (taxels,) [counts] of a touch around a position of the grid."""
    rows, columns = np.divmod(np.arange(TAXELS), COLUMNS)
    return peak * np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / (2.0 * width**2))


def block(
    subject: OnePatch, signal: np.ndarray, times: np.ndarray, noise: float, generator: np.random.Generator
) -> Iterator[np.ndarray]:
    """Returns the pressures (taxels,) of frames at `times`; `signal` (frames, taxels) [counts] is relative to
    rest."""
    own = subject.patch.sensor
    raw = own.rest - signal + noise * generator.standard_normal((len(times), TAXELS))
    counts = np.clip(np.rint(raw), own.lowest, own.highest)
    for stamp, values in zip(times, counts, strict=True):
        yield subject.pressure(values, float(stamp))
