"""A simulated NAO, shown as `tci serve nao --via VIA` shows it, for tests: `python patient.py VIA [NAME]`.

Its times are longer than those of the description, so that a busy machine is no fault. It prints `ready`,
then a line for each change of the gate's state, with its reason.
"""

from __future__ import annotations

import sys

import tci
from tci.middleware.simulated import SimulatedLink
from tci.model.description import Robot
from tci.runtime.loop import Tick
from tci.runtime.registry import open_server
from tci.runtime.serve import serve

PATIENCE = 0.5
"""Silence [s] after which something counts as lost in these tests."""


def patient(name: str) -> Robot:
    """A robot by name that waits for `PATIENCE` before it holds."""
    robot = tci.load_robot(name)
    bindings = tuple(binding.model_copy(update={"stale_after": PATIENCE}) for binding in robot.bindings)
    return robot.model_copy(update={"bindings": bindings})


def main() -> None:
    state: list[str] = []

    def tell(tick: Tick) -> None:
        if not state:
            print("ready", flush=True)
        if not state or state[0] != tick.sent.state.value:
            state[:] = [tick.sent.state.value]
            print(tick.sent.state.value, tick.sent.reason, flush=True)

    name = sys.argv[2] if len(sys.argv) > 2 else "nao"
    with SimulatedLink(patient(name), paced=True) as link, open_server(link, sys.argv[1]) as server:
        serve(server, observe=tell)


if __name__ == "__main__":
    main()
