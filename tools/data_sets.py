"""Times data sets: an hour of rows with touch, and recordings.

python tools/data_sets.py [RECORDING ...] [--minutes 60] [--taxels 1000] [--fps 100] [--out out/data_sets]

Rows are made beforehand and repeated, so that their making takes no time: forces on all taxels twice (those
of the patch, and of all), raw skin at the rate of the set with its stamps, angles and contacts. `tci log
export` exports the recordings, in a process of its own, as a set of LeRobot and as one of Open-X-Tactile.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import tci
from tci.datasets import episodes as sets
from tci.datasets import write_lerobot
from tci.datasets.episodes import Columns, DataSet, Episode, Feature
from tci.recording.recording import Recording

TOUCHED = 0.2
"""Share of the blocks in which something touches."""


class Made(DataSet):
    """Rows that nobody recorded."""

    def blocks(self, episode: Episode) -> Iterator[Columns]:
        chance, left = np.random.default_rng(0), episode.frames
        kinds = [self._block(chance, touched=n == 0) for n in range(2)]
        while left > 0:
            block = kinds[int(chance.random() > TOUCHED)]
            yield {name: values[:left] for name, values in block.items()}
            left -= sets.BLOCK

    def _block(self, chance: np.random.Generator, *, touched: bool) -> Columns:
        sizes = {name: one.size for name, one in self.features.items()}
        force = np.zeros((sets.BLOCK, sizes[sets.FORCES]))
        if touched:
            force[:, :60] = chance.gamma(2.0, 0.2, (sets.BLOCK, 60))
        raw = chance.integers(230, 250, (sets.BLOCK, sizes[sets.FORCES])) - 40 * (force > 0.0)
        angles = np.cumsum(chance.normal(0.0, 1e-3, (sets.BLOCK, sizes[sets.STATE])), axis=0)
        stamps = np.arange(sets.BLOCK)[:, None] * (10**9 // self.fps) + 10**18
        found = {
            sets.STATE: angles, sets.ACTION: angles + 1e-3, sets.FORCES: force,
            f"{sets.TACTILE}.skin": force, f"{sets.RAW}.skin": raw,
            f"{sets.COUNT}.skin": np.ones((sets.BLOCK, 1)), f"{sets.STAMPS}.skin": stamps,
            sets.CONTACTS: chance.normal(0.0, 1.0, (sets.BLOCK, sizes[sets.CONTACTS])) * touched,
        }  # fmt: skip
        return {name: values.astype(self.features[name].dtype) for name, values in found.items()}


def table(out: Path, minutes: float, taxels: int, fps: int) -> None:
    """Writes `minutes` of rows in episodes of a minute."""
    kinds = {sets.STATE: ("float32", 26), sets.ACTION: ("float32", 26), sets.FORCES: ("float32", taxels)}
    kinds |= {sets.CONTACTS: ("float32", 7 * sets.STRONGEST), f"{sets.TACTILE}.skin": ("float32", taxels)}
    kinds |= {
        f"{sets.RAW}.skin": ("uint8", taxels),
        f"{sets.COUNT}.skin": ("int64", 1),
        f"{sets.STAMPS}.skin": ("int64", 1),
    }
    features = {name: Feature(dtype, size) for name, (dtype, size) in kinds.items()}
    rows, robot = round(60 * fps * minutes), tci.load_robot("nao")
    nothing = Recording.__new__(Recording)
    minute = 60 * fps
    lengths = [min(minute, rows - begin) for begin in range(0, rows, minute)]
    episodes = tuple(Episode(nothing, "touch", length) for length in lengths)
    begun, spent = time.perf_counter(), time.process_time()
    write_lerobot(Made(robot, fps, features, episodes, {}, ()), out)
    took, used = time.perf_counter() - begun, time.process_time() - spent
    size = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(
        f"{rows} rows ({minutes:g} minutes) with {taxels} taxels and statistics: {took:.1f} s, {used:.1f} s "
        f"of processor time, {most:.0f} MB of memory, {size / 1e6:.0f} MB written",
        flush=True,
    )


def export(recording: Path, out: Path) -> None:
    """Exports a recording as a user does."""
    begin, end = Recording(recording).span()
    for form in ("lerobot", "oxt"):
        words = [Path(sys.executable).with_name("tci"), "log", "export", recording, out / form]
        begun = time.perf_counter()
        child = subprocess.Popen([*words, "--format", form, "--task", "touch"], stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(child.pid, 0)
        took, spent = time.perf_counter() - begun, used.ru_utime + used.ru_stime
        print(
            f"{recording.name}, {end - begin:.0f} s, as {form}: {took:.1f} s, {(end - begin) / took:.0f} "
            f"times faster than recorded; {spent:.1f} s of processor time "
            f"({(end - begin) / spent:.0f} times), {used.ru_maxrss / 1e3:.0f} MB of memory, status {status}",
            flush=True,
        )


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("recordings", nargs="*", type=Path)
    words.add_argument("--minutes", type=float, default=60.0)
    words.add_argument("--taxels", type=int, default=1000)
    words.add_argument("--fps", type=int, default=100)
    words.add_argument("--out", type=Path, default=Path("out/data_sets"))
    given = words.parse_args()
    shutil.rmtree(given.out, ignore_errors=True)
    given.out.mkdir(parents=True)
    if given.minutes:
        table(given.out / "table", given.minutes, given.taxels, given.fps)
    for recording in given.recordings:
        export(recording, given.out / recording.stem)


if __name__ == "__main__":
    main()
