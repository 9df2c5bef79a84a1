"""Work on all cores, for as long as there is time."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

from rich.progress import track

Result = TypeVar("Result")


def spread(work: Callable[..., Result], jobs: Sequence[tuple[object, ...]], words: str) -> list[Result]:
    """The results of `work` for each of `jobs`; of fewer, when MINUTES (in the environment) have passed."""
    until = time.monotonic() + 60.0 * float(os.environ.get("MINUTES", "inf"))
    done = []
    with ProcessPoolExecutor(int(os.environ.get("JOBS", os.cpu_count() or 1))) as pool:
        waiting = [pool.submit(work, *job) for job in jobs]
        for one in track(as_completed(waiting), words, total=len(waiting)):
            if not one.cancelled():
                done.append(one.result())
            if time.monotonic() > until:
                for other in waiting:
                    other.cancel()
    return done
