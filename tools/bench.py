"""How long the parts of the loop take, each beside a bare peer in the same run.

    python tools/bench.py [--json]

Each figure is the median of 7 rounds, in microseconds; the ratio is ours to the peer's. Timings of the two
take turns, so that a machine that slows down slows both.
"""

from __future__ import annotations

import json
import statistics
import sys
import time
from collections.abc import Callable

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table
from ruckig import InputParameter, OutputParameter, Ruckig
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

import tci
from tci.interface.contacts import ContactSettings, find_clusters
from tci.interface.part import to_platform
from tci.messages import GenericCommand, Mode
from tci.model.kinematics import Kinematics
from tci.model.mujoco_model import load_spec
from tci.trials.same_stimulus import initial_joints

ROUNDS, CALLS = 7, 400


def microseconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    for _ in range(CALLS):
        work()
    return (time.perf_counter() - start) / CALLS * 1e6


def gate_and_ruckig(robot: tci.Robot) -> tuple[Callable[[], object], Callable[[], object]]:
    """Five joints in motion: the whole gate, with its check that it can stop, and one ruckig update."""
    gate = tci.Gate(robot, period=0.002, stale_after=1e9)
    joints = initial_joints(robot)
    near, far = robot.part("left_arm").initial_posture, np.deg2rad([60.0, 60.0, 30.0, 40.0, 30.0])
    commands = [
        to_platform(robot, GenericCommand("left_arm", Mode.POSITION, target)) for target in (near, far)
    ]
    count = 0

    def ours() -> object:
        nonlocal count
        count += 1
        return gate.step([commands[count // 40 % 2]] if count % 40 == 0 else [], joints, 0.0)

    motion, request, answer = Ruckig(5, 0.002), InputParameter(5), OutputParameter(5)
    request.max_velocity, request.max_acceleration, request.max_jerk = [5.0] * 5, [60.0] * 5, [4800.0] * 5
    ticks = 0

    def peer() -> object:
        nonlocal ticks
        ticks += 1
        request.target_position = [0.5 if ticks // 40 % 2 else -0.5] * 5
        result = motion.update(request, answer)
        answer.pass_to_input(request)
        return result

    return ours, peer


def clusters_and_scipy(robot: tci.Robot) -> tuple[Callable[[], object], Callable[[], object]]:
    """Single-link clusters of one touch: ours on the surface's neighbours, and SciPy's on a k-d tree."""
    surface = tci.Skin(robot).surfaces["left_forearm"]
    distance = np.linalg.norm(surface.positions - surface.positions[100], axis=1)
    forces = np.where(distance < 0.015, 0.5, 0.0)
    settings = ContactSettings()

    def peer() -> object:
        active = np.flatnonzero(forces > settings.floor)
        pairs = cKDTree(surface.positions[active]).query_pairs(0.015, output_type="ndarray")
        size = len(active)
        graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
        return connected_components(graph, directed=False)

    return lambda: find_clusters(forces, surface.neighbours, settings), peer


def kinematics_and_mujoco(robot: tci.Robot) -> tuple[Callable[[], object], Callable[[], object]]:
    """Poses of four links: ours from joint angles to torso frame, and MuJoCo's mj_kinematics alone."""
    kinematics, position = Kinematics(robot), robot.initial_position
    links = [patch.link for patch in robot.patches]
    assert robot.model is not None
    model = load_spec(robot.model).compile()
    data = mujoco.MjData(model)
    return lambda: kinematics.poses(position, links), lambda: mujoco.mj_kinematics(model, data)


def main() -> None:
    rows = []
    robot = tci.load_robot("nao")
    for name, peer_name, pair in (
        ("gate, 5 joints moving", "one ruckig update", gate_and_ruckig(robot)),
        ("clusters of one touch", "SciPy k-d tree and components", clusters_and_scipy(robot)),
        ("forward kinematics, 4 links", "mj_kinematics", kinematics_and_mujoco(robot)),
    ):
        rounds = [(microseconds(pair[0]), microseconds(pair[1])) for _ in range(ROUNDS)]
        ours, peer = (statistics.median(times) for times in zip(*rounds, strict=True))
        ratios = sorted(a / b for a, b in rounds)
        rows.append(
            {
                "what": name, "peer": peer_name, "ours_us": ours, "peer_us": peer,
                "ratio": statistics.median(ratios), "ratio_min": ratios[0], "ratio_max": ratios[-1],
            }
        )  # fmt: skip
    if "--json" in sys.argv:
        print(json.dumps(rows, indent=2))
        return
    table = Table("what", "us", "peer", "us", "ratio", "spread", title="NAO, medians of 7 rounds")
    for row in rows:
        table.add_row(
            str(row["what"]), f"{row['ours_us']:.1f}", str(row["peer"]), f"{row['peer_us']:.1f}",
            f"{row['ratio']:.2f}", f"{row['ratio_min']:.2f} to {row['ratio_max']:.2f}",
        )  # fmt: skip
    Console().print(table)


if __name__ == "__main__":
    main()
