"""Compares the first motion of a reflex over a G1's topics with the first motion within one process."""

from __future__ import annotations

import numpy as np
from pool import Result, gather
from row import Row

from tci.capabilities.withdrawal import WithdrawalReflex
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.poke import Stimulus
from tci.robot.catalogue import load_robot

WIRES = None, "unitree:lo/116 + yarp"
"""Connections between reflex and robot: None for a reflex within the robot's process, otherwise the address
of two middleware: joints over Unitree's topics, skin sleeves over YARP."""
POKES = 10
"""Number of pokes of one job: five fields of two arms."""
ABOVE = 10.0
"""Largest time [ms] by which the middleware may delay the first motion."""


def unitree_motion(full: bool) -> Row:
    """Pokes each field of both arms. The robot, the keeper of its motors and the reflex run in separate
    processes."""
    jobs = [(via, POKES * number) for via in WIRES for number in range(3 if full else 1)]
    done = gather("unitree_motion", _pokes, jobs, full=full, alone=True)
    near, far = (
        np.array([time for one in done if one["wire"] is wire for time in one["first"]], dtype=float)
        for wire in (False, True)
    )
    pokes = min(len(near), len(far))
    late = far[:pokes] - near[:pokes]  # NaN if the robot never moved
    above = float(np.median(late)) if pokes else np.nan
    least, most = (bound(late, initial=0.0) for bound in (np.min, np.max))
    return Row(
        "delay of a G1's first motion, caused by the connection over Unitree's topics",
        pokes,
        3 * POKES,
        "pokes",
        f"median {above:.0f} ms, smallest {least:.0f} ms, largest {most:.0f} ms",
        f"median at most {ABOVE:g} ms",
        bool(above <= ABOVE),
    )


def _pokes(via: str | None, seed: int) -> Result:
    trials = [*trials_of(load_robot("g1"), WithdrawalReflex(), stimulus=Stimulus(), seed=seed, via=via)]
    return {"wire": via is not None, "first": [trial.first_motion_ms for trial in trials]}
