"""Simulates many worlds on several cores, at full speed and without a screen."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields
from tci.errors import TciError
from tci.experiments.poke import Stimulus, poke
from tci.frames import Array
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.simulation.world import World

SIDES = ("left_arm", "right_arm")


@dataclass(frozen=True, slots=True, eq=False)
class WorldRun:
    """Result of one world: one poke at one place."""

    world: int
    """Number of the world; its seed is the seed of the run plus this number."""
    part: str
    """Arm that was poked."""
    site: str
    """Name of the receptive field that was poked at its centre."""
    first_contact: float | None
    """Time [s] of the finger's first contact; None without contact."""
    first_command: float | None
    """Time [s] of the capability's first command; None without one."""
    contact_lost: float | None
    """Time [s] when the finger last lost contact; None if contact lasted to the end."""
    peak_force: float
    """Largest contact force [N] in the physics."""
    positions: Array
    """Angles (n_servos,) [rad] of all servos at the end."""
    simulated: float
    """Simulated time [s]."""
    took: float
    """Computing time [s] on one core, without building the world."""


def simulate(
    robot: str | Robot,
    capability: Capability[Any] | None = None,
    *,
    worlds: int = 1,
    duration: float = 1.0,
    step: float = 0.001,
    noise: float = 0.0,
    seed: int = 0,
    cores: int | None = None,
    sites: Sequence[ReceptiveField] | None = None,
) -> tuple[WorldRun, ...]:
    """Pokes a robot in `worlds` worlds, each for `duration` [s]; a world's seed sets arm, place and time.

    The skins of both arms, the capability (by default the withdrawal reflex) and the gate run in each world.
    Worlds are independent: equal arguments give equal runs on any number of `cores` (default: all). Each core
    runs a separate process. `sites` are the places (default: the reflex's fields); `step` [s] and `noise`
    [counts] are those of `World`. A program that calls this from a file needs `if __name__ == "__main__":`
    around it.

    Raises TciError for fewer than one world or core, no sites or no duration, and the errors of a world.
    """
    places = default_fields() if sites is None else tuple(sites)
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    used = min(available if cores is None else cores, worlds)
    if used < 1 or not places:
        raise TciError(f"{worlds} worlds on {cores} cores, {len(places)} sites; valid: at least one of each")
    if not 0.0 < duration < np.inf:
        raise TciError(f"duration {duration}; valid: above 0 s, and finite")
    words = load_robot(robot) if isinstance(robot, str) else robot
    if capability is None:
        from tci.capabilities.withdrawal import WithdrawalReflex

        capability = WithdrawalReflex()
    job = partial(_run, words, capability, places, duration, step, noise, seed)
    shares = [range(core, worlds, used) for core in range(used)]
    if used == 1:
        runs = job(shares[0])
    else:
        # A fork would copy the locks of threads without the threads.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(used, mp_context=context) as pool:
            runs = [run for share in pool.map(job, shares) for run in share]
    return tuple(sorted(runs, key=lambda run: run.world))


def _run(
    robot: Robot,
    capability: Capability[Any],
    sites: Sequence[ReceptiveField],
    duration: float,
    step: float,
    noise: float,
    seed: int,
    numbers: range,
) -> list[WorldRun]:
    """Runs the worlds of one process, one after another, in one world that is reset."""
    runs = []
    world = World(robot, step=step, noise=noise)
    for number in numbers:
        own = seed + number
        random = np.random.default_rng(own)
        part, site = SIDES[random.integers(2)], sites[int(random.integers(len(sites)))]
        world.reset(seed=own)
        start = time.perf_counter()
        trace = poke(world, part, site, Stimulus(duration=duration), reflex=capability, seed=own)
        took = time.perf_counter() - start
        runs.append(
            WorldRun(
                world=number,
                part=part,
                site=site.name,
                first_contact=trace.first_contact,
                first_command=trace.commanded[0][0] if trace.commanded else None,
                contact_lost=trace.contact_lost,
                peak_force=trace.peak_force,
                positions=trace.positions[-1],
                simulated=world.time,
                took=took,
            )
        )
    return runs
