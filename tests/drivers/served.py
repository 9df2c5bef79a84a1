"""A robot served by `tci serve` in a process of its own: a genuine peer over a real socket."""

from __future__ import annotations

import atexit
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec

import pytest


def needs_qi() -> None:
    """Go on only where NAOqi's library is; elsewhere the test is named as not run."""
    if find_spec("qi") is None:
        pytest.skip("did not run: needs qi, which is there for Linux on x86_64 with Python 3.11 or 3.12")


class Served:
    """A process that serves; `kill` it as hard as a test wants."""

    def __init__(self, robot: str, via: str, *options: str, source: str = "sim") -> None:
        command = [sys.executable, "-m", "tci.cli.main", "serve", robot, "--via", via, "--from", source]
        self.process = subprocess.Popen(
            [*command, *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            env={**os.environ, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        self.said: list[str] = []
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.append(line)
            if "serving" in line:
                self.where = line.strip()
                return
        raise AssertionError(f"tci serve ended: {''.join(self.said)}")

    @property
    def port(self) -> int:
        """The port that it says."""
        found = re.search(r"127\.0\.0\.1:(\d+)", self.where)
        assert found is not None, self.where
        return int(found[1])

    @property
    def address(self) -> str:
        """What a driver connects to, where it is said as NAME:HOST:PORT."""
        found = re.search(r"\w+:[\d.]+:\d+", self.where)
        assert found is not None, self.where
        return found[0]

    def stop(self) -> Sequence[str]:
        """End it as an operator does; returns what it said."""
        self.process.terminate()
        rest, _ = self.process.communicate(timeout=60)
        return [*self.said, rest]

    def kill(self) -> None:
        """End it with -9."""
        self.process.kill()
        self.process.communicate()


@cache
def served(robot: str, via: str) -> Served:
    """One such process for all tests of a run that leave it alive."""
    one = Served(robot, via)
    atexit.register(one.kill)
    return one
