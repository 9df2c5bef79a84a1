"""Sweeps as an array of a cluster's scheduler, by submitit: one task for each shard. Opens no port."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from tci.errors import CommandError
from tci.lab.sweeps.sweep import Shard, Sweep
from tci.support.installed import needs

EVERY = 1.0
"""Time [s] between two looks at what is done."""


@dataclass(frozen=True, slots=True)
class _Task:
    """What a node runs. It can be pickled, and goes on after the scheduler has taken its node away."""

    sweep: Sweep
    workers: int

    def __call__(self, shard: Shard) -> str:
        self.sweep.run(shard=shard, workers=self.workers)
        return str(shard)

    def checkpoint(self, shard: Shard) -> Any:
        """submitit's word for what runs again: the same shard, of which what is done is kept."""
        import submitit

        return submitit.helpers.DelayedSubmission(self, shard)


def compile_loops() -> str:
    """Compiles all loops, so that the tasks of an array only load them."""
    import_module("tci.gate.gate")
    return os.uname().nodename


@dataclass(frozen=True, slots=True)
class Array:
    """The tasks of a sweep on a cluster."""

    sweep: Sweep
    tasks: Mapping[Shard, Any]
    """submitit's job of each shard."""

    @property
    def name(self) -> str:
        """As the scheduler calls it."""
        return str(next(iter(self.tasks.values())).job_id).partition("_")[0]

    def wait(self, progress: Callable[[int, int], None] = lambda done, of: None) -> None:
        """Waits for all tasks. `progress` is called with the number of jobs that are done, and of all. Raises
        CommandError with the shards that failed, and where their output is."""
        while True:
            kept = len(self.sweep.kept())
            progress(kept, len(self.sweep.jobs))
            if kept == len(self.sweep.jobs):  # a scheduler without accounting tells it a minute later
                return
            if all(task.done() for task in self.tasks.values()):
                break
            time.sleep(EVERY)
        failed = []
        for shard, task in self.tasks.items():
            if (error := task.exception()) is not None:
                failed.append(f"{shard}: {_said(error)} ({task.paths.stderr})")
        if failed:
            raise CommandError(
                f"{len(failed)} of {len(self.tasks)} shards failed: {'; '.join(failed[:3])}; the same "
                "command again does what is missing"
            )


def submit(
    sweep: Sweep, shards: int, *, cluster: str = "slurm", workers: int = 1, minutes: int = 60,
    options: Mapping[str, str] | None = None, tell: Callable[[str], None] = lambda words: None,
) -> Array:  # fmt: skip
    """Starts those of `shards` shards that are not done, once TCI's loops are compiled: by one job, where
    tasks run elsewhere.

    Args:
        sweep: its folder must be the same one on all nodes.
        shards: number of tasks.
        cluster: as submitit calls it: slurm, or local, where all tasks start at once on this machine.
        workers: processes, and processors, of each task.
        minutes: longest duration of a task; then, or when its node is wanted, it goes on as a new one.
        options: of Slurm, such as partition or account, without dashes.
        tell: called with words of what it waits for.

    Raises MissingExtraError without submitit, and CommandError if the scheduler is missing or refuses.
    """
    with needs("a sweep on a cluster", "cluster"):
        import submitit
    missing = sweep.missing_shards(shards)
    if not missing:
        raise CommandError(f"all {len(sweep.jobs)} jobs are done; valid: --merge")
    try:
        executor = submitit.AutoExecutor(folder=sweep.folder / "tasks", cluster=cluster)
        executor.update_parameters(
            name="tci", timeout_min=minutes, cpus_per_task=workers,
            **{f"slurm_{name}": _number(value) for name, value in (options or {}).items()},
        )  # fmt: skip
        if cluster == "local":  # the tasks share this machine, and so what it has compiled
            compile_loops()
        else:
            tell("one job compiles TCI's loops, before the others start")
            executor.submit(compile_loops).result()
        tasks = executor.map_array(_Task(sweep, workers), missing)
    except (RuntimeError, NameError, ValueError, OSError) as error:
        raise CommandError(f"{cluster}: {_said(error)} (output: {sweep.folder / 'tasks'})") from error
    return Array(sweep, dict(zip(missing, tasks, strict=True)))


def _said(error: Exception) -> str:
    """What failed: the last error of the traceback that submitit's errors hold, else their first line."""
    named = re.findall(r"^[A-Za-z_][\w.]*: .+$", str(error), re.MULTILINE)
    return (named[-1:] or str(error).splitlines() or [type(error).__name__])[0]


def _number(value: str) -> int | str:
    with suppress(ValueError):
        return int(value)
    return value
