"""Sends hostile commands and false readings to simulated joints whose masses the gate does not know."""

from __future__ import annotations

from attacks import robot_of
from pool import Job, Result, gather
from row import Row

from helpers.closed_loop import ClosedLoop
from tci.messages import CONTROL_MODES, Mode
from tci.robot.catalogue import robot_names

CHUNK = 20_000
"""Number of cycles of one attack. Each attack has another random seed and other masses."""


def plant(full: bool) -> Row:
    """Checks the true position, speed and energy of the joints in each mode, for any command and any
    reading."""
    done = gather("plant", _one, _jobs(full), full=full)
    faults = [fault for result in done for fault in result["faults"]]
    for fault in faults[:10]:
        print(fault)
    shares: dict[str, float] = {}
    for result in done:
        for what, share in result["largest"].items():
            shares[what] = max(shares.get(what, 0.0), share)
    nearest = max(shares, key=lambda what: shares[what], default="nothing")
    wrong = sum(result["wrong"] for result in done)
    return Row(
        f"joints whose masses the gate does not know, in {len(CONTROL_MODES)} modes",
        sum(result["cycles"] for result in done),
        4e6,
        "cycles",
        f"false readings began {wrong} times; {len(faults)} values outside their limits; "
        f"largest share of a limit: {nearest}, {shares.get(nearest, 0.0):.0%}",
        "0 true positions, speeds or energies of a joint outside their limits",
        not faults,
    )


def _jobs(full: bool) -> list[Job]:
    """Returns the jobs (robot, mode, seed, cycles). Half of the jobs use the made robot of the tests, whose
    simulation is faster."""
    cycles, count = (CHUNK, 25) if full else (1500, 1)
    jobs: list[Job] = []
    for mode in CONTROL_MODES:
        others = ["icub"] if mode is Mode.TORQUE else robot_names()
        for seed in range(count):
            jobs += [
                ("tester", mode.value, seed, cycles),
                (others[seed % len(others)], mode.value, seed, cycles),
            ]
    return jobs


def _one(name: str, mode: str, seed: int, cycles: int) -> Result:
    """Runs one attack and returns its result."""
    loop = ClosedLoop(robot_of(name), seed, Mode(mode))
    for _ in range(cycles):
        loop.step()
    faults = [f"{name}, {mode}, {seed}: {fault}" for fault in loop.true.faults]
    return {
        "cycles": loop.counts.steps,
        "wrong": sum(count for fault, count in loop.tried.items() if fault not in ("none", "calm")),
        "faults": faults,
        "largest": loop.true.largest,
    }
