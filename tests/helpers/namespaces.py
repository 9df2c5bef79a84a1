"""Simulates machines as network namespaces, for tests of data that cross a network. No data leave these
namespaces."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from helpers import TESTS

ROUTER = "10.77.0.1"


def needs_namespaces() -> None:
    """Skips the test, and lists it as not run, if no namespace can be created. Most containers lack this
    permission."""
    probe = f"tci{os.getpid()}-probe"
    try:
        subprocess.run(["ip", "netns", "add", probe], check=True, capture_output=True)
        try:
            subprocess.run(["ip", "-n", probe, "link", "set", "lo", "up"], check=True, capture_output=True)
        finally:
            subprocess.run(["ip", "netns", "delete", probe], check=False, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("did not run: needs network namespaces: as root, with iproute2, outside of a container")


class Network:
    """A router with a separate cable to each of two machines."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.machines = ("robots", "minds")
        self.running: list[subprocess.Popen[str]] = []
        for machine in ("router", *self.machines):
            self.ip("netns", "add", self.at(machine))
            self.ip("-n", self.at(machine), "link", "set", "lo", "up")
        self.ip("-n", self.at("router"), "address", "add", f"{ROUTER}/32", "dev", "lo")
        for number, machine in enumerate(self.machines, start=1):
            here, there = f"10.77.{number}.2", f"10.77.{number}.1"
            wire = ["link", "add", machine, "type", "veth", "peer", "name", "eth", "netns", self.at(machine)]
            self.ip("-n", self.at("router"), *wire)
            for end, device, address in (("router", machine, there), (machine, "eth", here)):
                self.ip("-n", self.at(end), "address", "add", f"{address}/24", "dev", device)
                self.ip("-n", self.at(end), "link", "set", device, "up")
            self.ip("-n", self.at(machine), "route", "add", ROUTER, "via", there)

    def at(self, machine: str) -> str:
        return f"{self.name}-{machine}"

    def ip(self, *words: str) -> None:
        subprocess.run(["ip", *words], check=True, capture_output=True, text=True)

    def start(self, machine: str, *words: str) -> subprocess.Popen[str]:
        command = ["ip", "netns", "exec", self.at(machine), sys.executable, *words]
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"}
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment,
            cwd=TESTS,
        )  # fmt: skip
        self.running.append(process)
        return process

    def says(self, machine: str, *words: str) -> str:
        """Runs a process on a machine until its end, and returns the output."""
        return self.start(machine, *words).communicate(timeout=120)[0]

    def cut(self, machine: str) -> None:
        self.ip("-n", self.at("router"), "link", "set", machine, "down")

    def mend(self, machine: str) -> None:
        self.ip("-n", self.at("router"), "link", "set", machine, "up")

    def end(self) -> None:
        for process in self.running:
            process.kill()
            process.communicate()
        for machine in ("router", *self.machines):
            subprocess.run(["ip", "netns", "delete", self.at(machine)], check=False)
