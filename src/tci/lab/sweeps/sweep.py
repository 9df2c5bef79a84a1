"""Many jobs of which none needs another: on all cores, resumed where they ended, in shards on many machines.

Every result is a line of a file in one folder. So a sweep that was interrupted goes on where it was, and
shards that ran anywhere are merged by putting their files into one folder.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import tci
from tci.errors import CommandError

Job = tuple[Any, ...]
"""Arguments of the work, JSON values."""
Result = dict[str, Any]
"""What the work found, JSON values; numbers may be infinite or NaN."""


@dataclass(frozen=True, slots=True)
class Shard:
    """A part of a sweep: every `of`-th job, from the one with the number `number` on."""

    number: int = 1
    """From 1 to `of`."""
    of: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.of:
            of = max(self.of, 1)
            raise CommandError(f"shard {self}; valid: 1/{of} to {of}/{of}")

    @classmethod
    def parse(cls, text: str) -> Shard:
        """A shard from words such as 3/64, the third of 64. Raises CommandError."""
        if not (match := re.fullmatch(r"(\d+)/(\d+)", text)):
            raise CommandError(f"shard {text!r}; valid: NUMBER/OF, such as 3/64 for the third of 64")
        return cls(int(match[1]), int(match[2]))

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"


@dataclass(frozen=True, slots=True)
class Sweep:
    """Jobs, the work that is done for each of them, and the folder that keeps what it found."""

    folder: Path
    work: Callable[..., Result]
    """Called with each job's arguments, in any process and any order: what it finds may depend on nothing
    else. Processes must be able to import it."""
    jobs: Sequence[Job]
    of: str
    """What the results depend on besides the jobs, see `digest`: others in the folder don't count."""

    def kept(self) -> dict[str, Result]:
        """The results in the folder, by their jobs as JSON, in the order of the jobs."""
        found = {line["job"]: line["result"] for line in lines(self.folder) if line["of"] == self.of}
        return {key: found[key] for key in map(json.dumps, self.jobs) if key in found}

    def results(self) -> list[Result]:
        """Those in the folder, in the order of the jobs."""
        return [*self.kept().values()]

    def run(
        self, *, shard: Shard | None = None, workers: int | None = None, until: float = float("inf"),
        progress: Callable[[int, int], None] = lambda done, of: None,
    ) -> None:  # fmt: skip
        """Does the jobs that have no result yet.

        Args:
            shard: the part to do; by default everything.
            workers: processes that work at the same time; by default one for each core.
            until: time [s] of `time.monotonic` from which on no further job begins.
            progress: called with the number of jobs of the shard that are done, and of all of them.

        After an error the other jobs are still done; then the first error is raised. A job that failed is
        tried again the next time.
        """
        shard = shard or Shard()
        jobs, kept = self.jobs[shard.number - 1 :: shard.of], self.kept()
        missing = [job for job in jobs if json.dumps(job) not in kept]
        done, failed = len(jobs) - len(missing), list[Exception]()
        progress(done, len(jobs))
        for job, outcome in self._outcomes(missing, workers or os.cpu_count() or 1, until):
            if isinstance(outcome, Exception):
                outcome.add_note(f"job {json.dumps(job)}")
                failed.append(outcome)
                continue
            self._keep(shard, job, outcome)
            done += 1
            progress(done, len(jobs))
        if failed:
            failed[0].add_note(f"{len(failed)} of {len(missing)} jobs failed; the others are kept")
            raise failed[0]

    def _outcomes(
        self, jobs: Sequence[Job], workers: int, until: float
    ) -> Iterator[tuple[Job, Result | Exception]]:
        if workers == 1 or len(jobs) == 1:
            for job in jobs:
                if time.monotonic() >= until:
                    return
                try:
                    yield job, self.work(*job)
                except Exception as error:
                    yield job, error
            return
        if not jobs or time.monotonic() >= until:
            return
        pool = ProcessPoolExecutor(workers, initializer=_leave_interrupts)
        try:
            waiting = {pool.submit(self.work, *job): job for job in jobs}
            for one in as_completed(waiting):
                if not one.cancelled():
                    yield waiting[one], _outcome(one)
                if time.monotonic() >= until:
                    for other in waiting:
                        other.cancel()
        finally:  # also after Ctrl-C: what has not begun is left out
            pool.shutdown(cancel_futures=True)

    def _keep(self, shard: Shard, job: Job, result: Result) -> None:
        """Appends a line to the shard's file, after the end of a line that a process which was killed left
        open."""
        self.folder.mkdir(parents=True, exist_ok=True)
        line = json.dumps({"of": self.of, "job": json.dumps(job), "result": result})
        with (self.folder / f"{shard.number}-of-{shard.of}.jsonl").open("ab+") as file:
            if file.tell():
                file.seek(-1, os.SEEK_END)
                line = line if file.read(1) == b"\n" else f"\n{line}"
            file.write(line.encode() + b"\n")

    def missing_shards(self, of: int) -> list[Shard]:
        """Those of `of` shards that are not done."""
        kept = self.kept()
        lacks = [json.dumps(job) not in kept for job in self.jobs]
        return [Shard(k + 1, of) for k in range(of) if any(lacks[k::of])]


def _leave_interrupts() -> None:
    """Ctrl-C is for the process that waits for this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _outcome(done: Future[Result]) -> Result | Exception:
    try:
        return done.result()
    except Exception as error:
        return error


def lines(folder: Path) -> Iterator[dict[str, Any]]:
    """The lines of all shards in a folder, of any sweep; those of the file that changed last come last."""
    for path in sorted(folder.glob("*-of-*.jsonl"), key=lambda path: path.stat().st_mtime):
        for line in path.read_text().splitlines():
            try:
                found = json.loads(line)
            except json.JSONDecodeError:
                continue  # a process was killed while it wrote
            yield found


def digest(**values: Any) -> str:
    """One word for what results depend on: `values` (JSON values) and the sources of TCI."""
    return hashlib.sha256(json.dumps([sources(), values], sort_keys=True).encode()).hexdigest()[:16]


@cache
def sources() -> str:
    """A digest of the package's sources and data."""
    root, made = Path(tci.__file__).parent, hashlib.sha256()
    for path in sorted(path for path in root.rglob("*") if path.suffix in SOURCES):
        made.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return made.hexdigest()[:16]


SOURCES = {".py", ".xml", ".toml", ".xsd", ".csv", ".npz"}
