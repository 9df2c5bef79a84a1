"""Feeds damaged bytes to readers of robot descriptions and of heartbeats."""

from __future__ import annotations

import random
import tempfile
from pathlib import Path

from fuzz import TARGETS, fuzz
from pool import Result, gather
from row import Row

from helpers.xml_sample import GOOD, damage
from tci.errors import TciError
from tci.robot.xml import read_robot
from tci.runtime.heartbeat import decode, encode


def descriptions(full: bool) -> Row:
    """Checks that a damaged description either raises a TciError or is read."""
    jobs = [(seed, 1_000) for seed in range(100 if full else 1)]
    done = gather("descriptions", _descriptions, jobs, full=full)
    uncaught = sum(result["uncaught"] for result in done)
    return Row(
        "damaged robot descriptions", sum(result["tried"] for result in done), 1e5, "files",
        f"{uncaught} uncaught errors", "0 uncaught errors", uncaught == 0,
    )  # fmt: skip


def _descriptions(seed: int, count: int) -> Result:
    chance, uncaught = random.Random(seed), 0
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
    return {"tried": count, "uncaught": uncaught}


def guided(full: bool) -> Row:
    """Runs libFuzzer on every reader of untrusted bytes. libFuzzer searches for inputs that execute new
    lines."""
    seconds, wanted = (600.0 if full else 14.0 / len(TARGETS)), 600.0
    done = gather("guided", _guided, [(name, seconds) for name in TARGETS], full=full)
    uncaught = [result["words"] for result in done if result["words"]]
    for words in uncaught:
        print(words)
    return Row(
        f"coverage-guided fuzzing of {len(TARGETS)} readers",
        sum(result["seconds"] for result in done),
        wanted * len(TARGETS),
        "s",
        f"{sum(result['runs'] for result in done)} inputs, {len(uncaught)} uncaught errors",
        "10 minutes for each reader, 0 uncaught errors",
        not uncaught,
    )


def _guided(name: str, seconds: float) -> Result:
    runs, words = fuzz(name, seconds)
    return {"seconds": seconds, "runs": runs, "words": words}


def heartbeats(full: bool) -> Row:
    """Checks that a damaged heartbeat is never accepted."""
    jobs = [(seed, 50_000) for seed in range(20 if full else 1)]
    done = gather("heartbeats", _heartbeats, jobs, full=full)
    wrong = sum(result["wrong"] for result in done)
    return Row(
        "damaged heartbeat messages", sum(result["tried"] for result in done), 1e6, "datagrams",
        f"{wrong} accepted as valid", "0 accepted as valid, 0 crashes", wrong == 0,
    )  # fmt: skip


def _heartbeats(seed: int, count: int) -> Result:
    chance, wrong = random.Random(seed), 0
    for sequence in range(count):
        good = encode("brain", sequence)
        bad = damage(good, chance)
        wrong += bad != good and decode(bad) is not None
    return {"tried": count, "wrong": wrong}
