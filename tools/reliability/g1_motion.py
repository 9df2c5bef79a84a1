"""First motion of a reflex over a G1's topics, beside the one within one process."""

from __future__ import annotations

import numpy as np
from pool import Result, gather
from row import Row

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.experiments.experiment import trials_of
from tci.experiments.poke import Stimulus
from tci.robot.catalogue import load_robot

WIRES = None, "unitree:lo/116 + yarp"
"""Places of the reflex: within the robot's process, and beyond two wires, with joints over the robot's topics
and sleeves of skin over YARP."""
POKES = 10
"""Number of pokes of one job: five fields of two arms."""
ABOVE = 10.0
"""Largest time [ms] that the wires may add."""


def unitree_motion(full: bool) -> Row:
    """Pokes each field of both arms; robot, process of its motors and reflex are processes of their own."""
    jobs = [(via, POKES * number) for via in WIRES for number in range(3 if full else 1)]
    done = gather("unitree_motion", _pokes, jobs, full=full, alone=True)
    near, far = (
        np.array([time for one in done if one["wire"] is wire for time in one["first"]], dtype=float)
        for wire in (False, True)
    )
    pokes = min(len(near), len(far))
    late = far[:pokes] - near[:pokes]  # NaN where it never moved
    above = float(np.median(late)) if pokes else np.nan
    least, most = (bound(late, initial=0.0) for bound in (np.min, np.max))
    return Row(
        "first motion of a reflex over a G1's topics", pokes, 3 * POKES, "pokes",
        f"median {above:.0f} ms above in-process, from {least:.0f} to {most:.0f}",
        f"median {ABOVE:g} ms above in-process", bool(above <= ABOVE),
    )  # fmt: skip


def _pokes(via: str | None, seed: int) -> Result:
    trials = [*trials_of(load_robot("g1"), WithdrawalReflex(), stimulus=Stimulus(), seed=seed, via=via)]
    return {"wire": via is not None, "first": [trial.first_motion_ms for trial in trials]}
