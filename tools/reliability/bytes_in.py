"""Damaged bytes into what reads bytes: robot descriptions and heartbeats."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

from fuzz import TARGETS, fuzz
from rich.progress import track
from row import Row

from model.test_xml import GOOD, damage
from tci.errors import TciError
from tci.model.xml import read_robot
from tci.runtime.heartbeat import decode, encode


def descriptions(full: bool) -> Row:
    """Damaged descriptions end in a TciError or are read."""
    count, chance, uncaught = (100_000 if full else 1_000), random.Random(5), 0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xml"
        for _ in range(count):
            path.write_bytes(damage(GOOD.encode(), chance))
            try:
                read_robot(path)
            except TciError:
                continue
            except Exception:
                uncaught += 1
    return Row("damaged descriptions", f"{count}", f"{uncaught} uncaught", "0 uncaught", uncaught == 0)


def guided(full: bool) -> Row:
    """libFuzzer looks for inputs that reach new lines of all that reads foreign bytes."""
    seconds = (600.0 if full else 14.0) / len(TARGETS)
    done = [fuzz(name, seconds) for name in track(TARGETS, "coverage-guided fuzzing")]
    uncaught = [words for _, words in done if words]
    for words in uncaught:
        print(words)
    return Row(
        f"coverage-guided fuzzing, {len(TARGETS)} readers",
        f"{sum(runs for runs, _ in done)} inputs in {seconds * len(TARGETS):.0f} s",
        f"{len(uncaught)} uncaught",
        "10 minutes, 0 uncaught",
        not uncaught,
    )


def heartbeats(full: bool) -> Row:
    """Damaged heartbeats are never taken for another beat."""
    count, chance, wrong = (1_000_000 if full else 50_000), random.Random(6), 0
    for sequence in range(count):
        good = encode("brain", sequence)
        bad = damage(good, chance)
        wrong += bad != good and decode(bad) is not None
    return Row("damaged heartbeats", f"{count}", f"{wrong} accepted", "0 accepted, 0 crashes", wrong == 0)
