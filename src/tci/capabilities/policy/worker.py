"""Computes a policy beside the loop. It only computes ahead: results depend on the observations alone."""

from __future__ import annotations

import time
from threading import Event, Thread
from typing import Any

import numpy as np

from tci.capabilities.policy.spec import Policy
from tci.messages.frames import Array

KEPT = 16
"""Calls that are remembered: more than parts that wait for one."""


class _Job(Thread):
    """A thread for each call: no call, no thread, and none outlives a program that ends."""

    def __init__(self, policy: Policy, seen: Array) -> None:
        super().__init__(name="policy", daemon=True)
        self._policy, self._seen, self.begun = policy, seen, time.perf_counter()
        self.done = Event()
        self.found: Array | None = None
        self.error: Exception | None = None

    def run(self) -> None:
        try:
            self.found = np.asarray(self._policy(self._seen.ravel()), np.float64)
        except Exception as error:
            self.error = error
        self.done.set()


class Worker:
    """Calls a policy beside the loop."""

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self._jobs: dict[bytes, _Job] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return Worker, (self.policy,)

    def start(self, seen: Array) -> None:
        """Begins to compute, unless it does already."""
        if (key := seen.tobytes()) not in self._jobs:
            while len(self._jobs) >= KEPT:  # nobody wants the oldest any more
                del self._jobs[next(iter(self._jobs))]
            self._jobs[key] = _Job(self.policy, seen)
            self._jobs[key].start()

    def result(self, seen: Array, within: float) -> Array | None:
        """What the policy gives for `seen`; None if it has not been done `within` [s] of its start. Raises
        what the policy raised."""
        self.start(seen)
        job = self._jobs[key := seen.tobytes()]
        if not job.done.wait(max(job.begun + within - time.perf_counter(), 0.0)):
            return None
        del self._jobs[key]
        if job.error is not None:
            raise job.error
        return job.found
