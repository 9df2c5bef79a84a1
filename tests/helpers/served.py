"""A robot that `tci serve` serves in a separate process, over a real socket."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec

import pytest


def needs_qi() -> None:
    """Skips the test, and lists it as not run, if NAOqi's library is not installed."""
    if find_spec("qi") is None:
        pytest.skip("did not run: needs qi, which is there for Linux on x86_64 with Python 3.11 or 3.12")


class Served:
    """A process that serves a robot. Tests may kill it."""

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
        """TCP port number that the process printed."""
        found = re.search(r"127\.0\.0\.1:(\d+)", self.where)
        assert found is not None, self.where
        return int(found[1])

    @property
    def address(self) -> str:
        """Address for a driver, from the line NAME:HOST:PORT that the process printed."""
        found = re.search(r"\w+:[\d.]+:\d+", self.where)
        assert found is not None, self.where
        return found[0]

    def stop(self) -> Sequence[str]:
        """Ends the process as an operator does, and returns the output."""
        self.process.terminate()
        rest, _ = self.process.communicate(timeout=60)
        return [*self.said, rest]

    def kill(self) -> None:
        """Ends the process with SIGKILL."""
        self.process.kill()
        self.process.communicate()
