"""Runs jobs on all cores until the time has passed. Stores results at full size and does not compute them
again."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from pathlib import Path
from typing import Any

from report import commit, out
from rich.progress import track

import tci

Job = tuple[Any, ...]
Result = dict[str, Any]
COMMITS: dict[str, str] = {}
"""Commit at which each row was measured, by the name under which its results are stored."""


def gather(
    name: str, work: Callable[..., Result], jobs: Sequence[Job], *, full: bool, alone: bool = False
) -> list[Result]:
    """Returns the results of `work` for each of `jobs`, or for fewer jobs if MINUTES (environment) have
    passed.

    At full size each result is appended to `OUT/reliability/NAME.jsonl`. Results in this file are used again
    if the sources have not changed, so the full size can be reached in several runs. JOBS processes work at
    the same time; with `alone`, one process. An error of a job is raised after the other jobs have ended.
    PART=0/2 runs only every second job. MINUTES=0 runs no job and returns the results that were stored last,
    of any version of the sources; `COMMITS` contains their commit.
    """
    kept = out() / "reliability" / f"{name}.jsonl"
    minutes = float(os.environ.get("MINUTES", "inf"))
    done = _kept(name, kept, last=minutes == 0.0) if full else {}
    jobs = [tuple(job) for job in jobs]
    part, parts = map(int, os.environ.get("PART", "0/1").split("/"))
    missing = [job for job in jobs[part::parts] if json.dumps(job) not in done]
    until = time.monotonic() + 60.0 * minutes
    count = 1 if alone else int(os.environ.get("JOBS", os.cpu_count() or 1))
    failed: list[Exception] = []
    if missing and time.monotonic() < until:
        with ProcessPoolExecutor(count) as pool:
            waiting = {pool.submit(work, *job): job for job in missing}
            for one in track(as_completed(waiting), name, total=len(waiting)):
                if one.cancelled():
                    continue
                job = json.dumps(waiting[one])
                try:
                    done[job] = one.result()
                except Exception as error:  # the others continue
                    error.add_note(f"{name} {job}")
                    failed.append(error)
                    print(f"{name} {job}: {type(error).__name__}: {error}", flush=True)
                    continue
                if full:
                    kept.parent.mkdir(parents=True, exist_ok=True)
                    with kept.open("a") as file:
                        line = {"sources": sources(), "commit": commit(), "job": job, "result": done[job]}
                        file.write(json.dumps(line) + "\n")
                if time.monotonic() > until:
                    for other in waiting:
                        other.cancel()
    if failed:
        raise failed[0]
    return [done[job] for job in map(json.dumps, jobs) if job in done]


def _kept(name: str, path: Path, *, last: bool) -> dict[str, Result]:
    """Returns stored results by job: those of the present sources or, with `last`, those that were stored
    last."""
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    wanted = lines[-1]["sources"] if lines and last else sources()
    lines = [line for line in lines if line["sources"] == wanted]
    COMMITS[name] = lines[-1].get("commit", "") if lines else commit()
    return {line["job"]: line["result"] for line in lines}


@cache
def sources() -> str:
    """Returns a digest of the package's sources."""
    root, digest = Path(tci.__file__).parent, hashlib.sha256()
    for path in sorted(path for path in root.rglob("*") if path.suffix in {".py", ".xml", ".toml", ".xsd"}):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]
