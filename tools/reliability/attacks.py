"""Sends hostile commands in every mode to every robot. The check of the results shares no code with the
gate."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from pool import Job, Result, gather
from row import Row

from helpers.gate_checks import LIMITS, make_robot
from helpers.hostile_commands import Attack
from tci.messages import CONTROL_MODES, Mode
from tci.messages.frames import Array
from tci.robot.catalogue import load_robot, robot_names
from tci.robot.collisions import exclude_overlaps, solid_spec
from tci.robot.description import Robot
from tci.robot.joint_map import initial_position

CHUNK = 10_000
"""Number of cycles of one attack. Each attack has another random seed."""
LOOK = 25
"""Number of cycles between two checks of the robot's body for overlaps."""


def limits(full: bool) -> Row:
    """Checks limits of position, velocity, acceleration, jerk and torque, and couplings between joints."""
    robots = ("tester", *robot_names())
    done = gather("limits", _one, _jobs(full, robots, 1000, body=False), full=full)
    faults = [fault for result in done for fault in result["faults"]]
    peak = max((result["peak"] for result in done), default=0.0)
    good, bad, passed = (sum(result[key] for result in done) for key in ("commands", "malformed", "passed"))
    return Row(
        f"hostile commands to {len(robots)} robots, in all modes",
        sum(result["cycles"] for result in done),
        1e7,
        "cycles",
        f"{good} commands, {bad} of them malformed; {passed} malformed commands accepted; "
        f"{len(faults)} outputs outside a limit; largest excess over a limit {peak:.0e}",
        "0 accepted, 0 outputs outside a limit, excess <= 1e-6",
        not faults and not passed and peak <= 1e-6,
    )


def bodies(full: bool) -> Row:
    """Checks that no two links of a robot overlap, whatever commands the gate receives."""
    robots = robot_names()
    done = gather("bodies", _one, _jobs(full, robots, 100, body=True), full=full)
    faults = [fault for result in done for fault in result["faults"]]
    deepest = max((result["overlap"] for result in done), default=0.0)
    near = sum(result["near"] for result in done)
    return Row(
        f"overlap of links during hostile commands to {len(robots)} robots",
        sum(result["cycles"] for result in done),
        1e6,
        "cycles",
        f"the gate ended {near} motions early; {len(faults)} outputs outside a limit; "
        f"deepest overlap {deepest * 1e3:.2f} mm",
        "0 outputs outside a limit, 0 overlaps",
        not faults and deepest <= 0.0 and (near > 0 or not full),
    )


def _jobs(full: bool, robots: Sequence[str], chunks: int, *, body: bool) -> list[Job]:
    """Returns the jobs (robot, seed, body, cycles). At CI size there is one seed for each robot, and few
    cycles."""
    seeds = range(-(-chunks // len(robots))) if full else (1,)
    return [(name, seed, body, CHUNK if full else 1_600) for seed in seeds for name in robots]


def robot_of(name: str) -> Robot:
    """Returns a robot of the catalogue. The name `tester` returns a made robot whose six servos support every
    mode."""
    if name == "tester":
        return make_robot(limits=LIMITS.model_copy(update={"torque": 5.0}), modes=CONTROL_MODES)
    return load_robot(name)


def _one(name: str, seed: int, body: bool, cycles: int) -> Result:
    """Runs one attack and returns its result."""
    robot = robot_of(name)
    # Torque mode is left out, because the position of a servo in torque mode is not controlled.
    modes = tuple(mode for mode in CONTROL_MODES if mode is not Mode.TORQUE or not body)
    attack = Attack(robot, seed, body=body, modes=modes)
    eyes = Eyes(robot) if body else None
    overlap = 0.0
    for cycle in range(cycles):
        attack.step()
        if eyes is not None and cycle % LOOK == 0:
            overlap = max(overlap, eyes.overlap(attack.angles))
    counts = attack.counts
    return {
        "cycles": counts.steps,
        "commands": counts.commands,
        "malformed": counts.malformed,
        "passed": counts.passed,
        "faults": attack.judge.faults,
        "peak": attack.judge.peak,
        # Deepest overlap [m] of two links, as found by MuJoCo's own collision detection.
        "overlap": overlap,
        "near": attack.gate.counts.near_misses,
    }


class Eyes:
    """MuJoCo's collision detection on a robot's links."""

    def __init__(self, robot: Robot) -> None:
        self._model = exclude_overlaps(solid_spec(robot), robot, initial_position(robot))
        self._data = mujoco.MjData(self._model)
        joints = [(s.index, self._model.joint(s.joint).qposadr[0]) for s in robot.servos if s.joint]
        self._servos, self._addresses = (list(column) for column in zip(*joints, strict=True))

    def overlap(self, angles: Array) -> float:
        """Returns the deepest overlap [m] of two links at `angles` (n_servos,) [rad]."""
        self._data.qpos[self._addresses] = angles[self._servos]
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        return float(np.max(-self._data.contact.dist[: self._data.ncon], initial=0.0))
