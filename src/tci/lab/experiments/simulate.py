"""Simulates many worlds on several cores, without a screen, as fast as the computer can."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from tci.capabilities.capability import Capability
from tci.capabilities.fields import ReceptiveField, default_fields
from tci.errors import TciError
from tci.lab.experiments.poke import Stimulus, poke
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.like import RobotLike, as_robot
from tci.simulation.world import World


@dataclass(frozen=True, slots=True, eq=False)
class WorldRun:
    """Result of one world, in which the finger poked one point."""

    world: int
    """Number of the world, from 0. The seed of the world is this number plus the `seed` of the call of
    `simulate`."""
    part: str
    """Arm that the finger poked."""
    site: str
    """Name of the receptive field whose centre the finger poked."""
    first_contact: float | None
    """Time [s] of the finger's first contact, or None if there was no contact."""
    first_command: float | None
    """Time [s] of the capability's first command, or None if there was no command."""
    contact_lost: float | None
    """Time [s] of the end of the finger's last contact, or None if the finger touched the skin until the
    end."""
    peak_force: float
    """Largest contact force [N] in the physics simulation."""
    positions: Array
    """Angles (n_servos,) [rad] of all servos at the end."""
    simulated: float
    """Simulated time [s]."""
    took: float
    """Computing time [s] on one core, without the time for building the world."""


def simulate(
    robot: RobotLike,
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
    """Pokes a robot in `worlds` simulated worlds, each for `duration` [s]. World i, counted from 0, has the
    seed `seed` + i, which determines the arm, the receptive field and the time of the poke.

    The skins of both arms, the capability (by default the withdrawal reflex) and the gate run in each world.
    Worlds are independent, so equal arguments lead to equal results on any number of `cores` (default: all
    cores). Each core runs a separate process. `sites` are the receptive fields to poke (default: the fields
    of the reflex). `step` [s] is the step of the physics, and `noise` [counts] the standard deviation of raw
    skin values. If a file calls this function, the call must be inside `if __name__ == "__main__":`.

    Raises TciError for fewer than one world or core, for an empty `sites`, and for an invalid duration.
    Raises the errors of `World`.
    """
    robot = as_robot(robot)
    places = default_fields() if sites is None else tuple(sites)
    available = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    used = min(available if cores is None else cores, worlds)
    if used < 1 or not places:
        raise TciError(f"{worlds} worlds on {cores} cores, {len(places)} sites; valid: at least one of each")
    if not 0.0 < duration < np.inf:
        raise TciError(f"duration {duration}; valid: above 0 s, and finite")
    if capability is None:
        from tci.capabilities.withdrawal import WithdrawalReflex

        capability = WithdrawalReflex()
    job = partial(_run, robot, capability, places, duration, step, noise, seed)
    shares = [range(core, worlds, used) for core in range(used)]
    if used == 1:
        runs = job(shares[0])
    else:
        # A forked process would have copies of locked locks, but not the threads that unlock these locks.
        context = multiprocessing.get_context("spawn")
        try:
            with ProcessPoolExecutor(used, mp_context=context) as pool:
                runs = [run for share in pool.map(job, shares) for run in share]
        except BrokenProcessPool as error:
            raise TciError(
                "a process of tci.simulate ended early; valid in a script: call it below "
                "if __name__ == '__main__', since each process imports the script"
            ) from error
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
    """Simulates the worlds with the given `numbers` one after another in this process, and returns their
    results. Each world has its own random seed, `seed` plus its number."""
    runs = []
    arms = sorted(part.name for part in robot.parts if part.kind == "arm")
    world = World(robot, step=step, noise=noise)
    for number in numbers:
        own = seed + number
        random = np.random.default_rng(own)
        part, site = arms[random.integers(len(arms))], sites[int(random.integers(len(sites)))]
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
