"""Runs jobs on all cores until the time has passed. Stores results at full size and does not compute them
again."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from report import commit, out
from rich.progress import Progress

from tci.lab.sweeps.sweep import Job, Result, Shard, Sweep, lines, sources

COMMITS: dict[str, str] = {}
"""Commit at which each row was measured, by the name under which its results are stored."""


@dataclass(frozen=True)
class _Work:
    """The work of a row, whose results also have the commit."""

    work: Callable[..., Result]
    commit: str

    def __call__(self, *job: object) -> Result:
        return {"commit": self.commit, "result": self.work(*job)}


def gather(
    name: str, work: Callable[..., Result], jobs: Sequence[Job], *, full: bool, alone: bool = False
) -> list[Result]:
    """Returns the results of `work` for each of `jobs`, or for fewer jobs if MINUTES (environment) have
    passed.

    At full size the results are kept in `OUT/reliability/NAME`. They are used again if the sources have not
    changed, so the full size can be reached in several runs. JOBS processes work at the same time; with
    `alone`, one process. An error of a job is raised after the other jobs have ended. SHARD=1/2 runs only
    every second job. MINUTES=0 runs no job and returns the results that were stored last, of any version of
    the sources; `COMMITS` contains their commit.
    """
    minutes = float(os.environ.get("MINUTES", "inf"))
    with tempfile.TemporaryDirectory() as passing:
        folder = out() / "reliability" / name if full else Path(passing)
        sweep = Sweep(folder, _Work(work, commit()), [tuple(job) for job in jobs], sources())
        if minutes == 0.0:
            sweep = replace(sweep, of=([line["of"] for line in lines(folder)] or [sweep.of])[-1])
        with Progress() as bar:
            task = bar.add_task(name, total=None)
            sweep.run(
                shard=Shard.parse(os.environ.get("SHARD", "1/1")),
                workers=1 if alone else int(os.environ.get("JOBS", os.cpu_count() or 1)),
                until=time.monotonic() + 60.0 * minutes,
                progress=lambda done, of: bar.update(task, completed=done, total=of),
            )  # fmt: skip
        found = sweep.results()
    COMMITS[name] = found[-1]["commit"] if found else commit()
    return [one["result"] for one in found]
