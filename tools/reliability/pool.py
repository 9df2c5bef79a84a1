"""Work on all cores, for as long as there is time. What was done at full size is kept, and not done again."""

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

from rich.progress import track

import tci

Job = tuple[Any, ...]
Result = dict[str, Any]


def gather(
    name: str, work: Callable[..., Result], jobs: Sequence[Job], *, full: bool, alone: bool = False
) -> list[Result]:
    """The results of `work` for each of `jobs`; of fewer, when MINUTES (in the environment) have passed.

    At full size they are written to `OUT/reliability/NAME.jsonl` one by one, and those that are there already
    count, if the sources are the same: the full size can be reached in pieces. JOBS processes work at once;
    `alone`: one job at a time.
    """
    kept = Path(os.environ.get("OUT", "out")) / "reliability" / f"{name}.jsonl"
    done = _kept(kept) if full else {}
    jobs = [tuple(job) for job in jobs]
    missing = [job for job in jobs if json.dumps(job) not in done]
    until = time.monotonic() + 60.0 * float(os.environ.get("MINUTES", "inf"))
    count = 1 if alone else int(os.environ.get("JOBS", os.cpu_count() or 1))
    if missing and time.monotonic() < until:
        with ProcessPoolExecutor(count) as pool:
            waiting = {pool.submit(work, *job): job for job in missing}
            for one in track(as_completed(waiting), name, total=len(waiting)):
                if one.cancelled():
                    continue
                job = json.dumps(waiting[one])
                done[job] = one.result()
                if full:
                    kept.parent.mkdir(parents=True, exist_ok=True)
                    with kept.open("a") as file:
                        line = {"sources": sources(), "job": job, "result": done[job]}
                        file.write(json.dumps(line) + "\n")
                if time.monotonic() > until:
                    for other in waiting:
                        other.cancel()
    return [done[job] for job in map(json.dumps, jobs) if job in done]


def _kept(path: Path) -> dict[str, Result]:
    """Results by job, of the sources as they are now."""
    if not path.exists():
        return {}
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    return {line["job"]: line["result"] for line in lines if line["sources"] == sources()}


@cache
def sources() -> str:
    """What tells one state of the package's sources from another."""
    root, digest = Path(tci.__file__).parent, hashlib.sha256()
    for path in sorted(path for path in root.rglob("*") if path.suffix in {".py", ".xml", ".toml", ".xsd"}):
        digest.update(str(path.relative_to(root)).encode() + path.read_bytes())
    return digest.hexdigest()[:16]
