"""How many steps of 20 ms a second many touched worlds make, with skin and without: a table, or JSON.

    python tools/many_worlds.py icub --engine warp --worlds 1024 4096 --json out.json
    python tools/many_worlds.py nao icub g1 --worlds 32 --threads 1 --modes bare skin
    python tools/many_worlds.py --plot docs/tables/many-worlds.json docs/images/many-worlds.png

Every world is poked at another place, and gets new targets for all servos in every step, as a policy would
send them. Also told is how many steps they make in a second of processor time. "bare": neither taxels nor
contact sensors, in the same scene; "sensors": contact sensors of MuJoCo, no taxels; "skin": all.
"""

from __future__ import annotations

import argparse
import itertools
import json
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "src"))

from tci.batch.cpu import MujocoWorlds
from tci.batch.scene import BatchScene, batch_scene
from tci.batch.worlds import Worlds
from tci.support.engine import mujoco

PERIOD = 0.02
"""Time [s] between two actions of a policy."""
MODES = ("bare", "sensors", "skin")
FEW = 32
"""Worlds of the robots that are compared with each other."""
SENSORS = int(mujoco.mjtDisableBit.mjDSBL_SENSOR)


def made(
    scene: BatchScene, count: int, mode: str, args: argparse.Namespace
) -> tuple[Worlds, Callable[[], None]]:
    """Worlds, and a function that waits for them."""
    if args.engine == "mujoco":
        flags = scene.model.opt.disableflags
        if mode == "bare":
            scene.model.opt.disableflags |= SENSORS
        worlds = MujocoWorlds(scene, count, threads=args.threads, skin=mode == "skin")
        scene.model.opt.disableflags = flags
        return worlds, lambda: None
    import warp as wp

    from tci.batch.gpu import WarpWorlds

    on_device = WarpWorlds(scene, count, device=args.device, skin=mode == "skin")
    if mode == "bare":
        on_device.model.opt.disableflags |= SENSORS
    return on_device, lambda: wp.synchronize_device(on_device.device)


def poke_all(worlds: Worlds, seed: int = 0) -> None:
    chance, scene = np.random.default_rng(seed), worlds.scene
    sleeves = [one.name for one in scene.robot.patches if one.segment]
    names = [str(chance.choice(sleeves)) for _ in range(worlds.count)]
    taxels = [int(chance.integers(len(scene.world.surfaces[name].positions))) for name in names]
    worlds.poke(names, taxels, depth=chance.uniform(0.004, 0.014, worlds.count))


def rates(
    scene: BatchScene, count: int, modes: tuple[str, ...], args: argparse.Namespace
) -> list[dict[str, Any]]:
    """Steps a second of each mode: medians of several blocks. The modes take turns, so that a machine that is
    busy with other things slows all of them."""
    chance = np.random.default_rng(1)
    home = scene.world.servos.asked["target"]
    moves = [home + chance.normal(0.0, 0.02, (count, len(home))).astype(np.float32) for _ in range(4)]
    ready, warm = [made(scene, count, mode, args) for mode in modes], []
    for worlds, wait in ready:
        poke_all(worlds)
        begun = time.perf_counter()
        for _ in range(8):  # until the fingers touch, and all graphs are recorded
            worlds.send(moves[0])
            worlds.advance(PERIOD)
        wait()
        warm.append(time.perf_counter() - begun)
    walls, busy = np.zeros((2, args.blocks, len(modes)))
    for block, k in itertools.product(range(args.blocks), range(len(modes))):
        worlds, wait = ready[k]
        begun, processor = time.perf_counter(), time.process_time()
        for step in range(args.steps):
            worlds.send(moves[step % len(moves)])
            worlds.advance(PERIOD)
        wait()
        walls[block, k] = time.perf_counter() - begun
        busy[block, k] = time.process_time() - processor
    steps, rows = count * args.steps, list[dict[str, Any]]()
    for k, mode in enumerate(modes):
        speeds = steps / walls[:, k]
        touched = float(ready[k][0].force.any(axis=1).mean()) if mode == "skin" else 0.0
        rows.append({
            "robot": scene.robot.name, "worlds": count, "taxels": scene.taxels, "step": scene.step,
            "mode": mode, "steps_per_second": float(np.median(speeds)),
            "spread": float(np.ptp(speeds) / np.median(speeds)), "touched": touched, "warm": warm[k],
            "per_processor_second": steps / float(np.median(busy[:, k])),
            "times_first": float(np.median(walls[:, k] / walls[:, 0])),
            "processor_times_first": float(np.median(busy[:, k] / busy[:, 0])),
        })  # fmt: skip
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*")
    parser.add_argument("--engine", choices=("mujoco", "warp"), default="mujoco")
    parser.add_argument("--device", help="of Warp; by default the first GPU")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--worlds", type=int, nargs="+", default=[16])
    parser.add_argument("--step", type=float, nargs="+", default=[0.002], help="of the physics [s]")
    parser.add_argument("--modes", nargs="+", default=MODES, choices=MODES)
    parser.add_argument("--steps", type=int, default=25, help="in a block")
    parser.add_argument("--blocks", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--plot", type=Path, nargs=2, help="draw a file of --json as a picture")
    args = parser.parse_args()
    if args.plot:
        plot(*args.plot)
        return
    rows = []
    for robot, step in itertools.product(args.robots, args.step):
        scene = batch_scene(robot, step=step)
        for count in args.worlds:
            for row in rates(scene, count, args.modes, args):
                rows.append(row | {"device": device_name(args)})
                print(
                    f"{robot} {count} worlds {step * 1e3:g} ms {row['mode']:8} "
                    f"{row['steps_per_second']:10.0f}/s "
                    f"x{row['times_first']:.3f} spread {row['spread']:.2f} touched {row['touched']:.2f} "
                    f"warm {row['warm']:.1f} s, {row['per_processor_second']:.0f} per processor second "
                    f"x{row['processor_times_first']:.3f}",
                    flush=True,
                )
                if args.json:
                    args.json.write_text(json.dumps(rows, indent=1))


def plot(measured: Path, picture: Path) -> None:
    """Draws steps a second over worlds, and steps a second of processor time over taxels, with skin and
    without."""
    import matplotlib.pyplot as plt

    rows = json.loads(measured.read_text())
    figure, (many, felt) = plt.subplots(1, 2, figsize=(11.0, 4.2), layout="constrained", width_ratios=(3, 2))
    robots = [row for row in rows if row["worlds"] == FEW]
    others = [row for row in rows if row not in robots]
    for colour, (device, step) in enumerate(dict.fromkeys((row["device"], row["step"]) for row in others)):
        for mode, line in (("skin", "o-"), ("bare", "o:")):
            own = [r for r in others if (r["device"], r["step"], r["mode"]) == (device, step, mode)]
            own.sort(key=lambda row: row["worlds"])
            name = f"{own[0]['taxels']} taxels" if mode == "skin" else "without skin"
            many.loglog(
                [r["worlds"] for r in own], [r["steps_per_second"] for r in own], line, color=f"C{colour}",
                label=f"{device}, {step * 1e3:g} ms, {name}",
            )  # fmt: skip
    many.set(xlabel="worlds", ylabel="steps of 20 ms per second", title="icub")
    robots.sort(key=lambda row: row["taxels"])
    for mode, name, fill in (("skin", "with skin", "C3"), ("bare", "without", "none")):
        own = [row for row in robots if row["mode"] == mode]
        speeds = [row["per_processor_second"] for row in own]
        felt.plot([row["taxels"] for row in own], speeds, "o", color="C3", mfc=fill, label=name)
    for row in robots:
        if row["mode"] == "skin":
            felt.annotate(
                f"{row['robot']} ", (row["taxels"], row["per_processor_second"]), fontsize=8, ha="center",
                va="top", xytext=(0, -6), textcoords="offset points",
            )  # fmt: skip
    felt.set(xlabel="taxels in each world", ylabel="steps of 20 ms per second of a processor", ylim=(0, None))
    felt.set_title(f"robots, {FEW} worlds each")
    for axes in (many, felt):
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    figure.savefig(picture, dpi=110)


def device_name(args: argparse.Namespace) -> str:
    if args.engine == "mujoco":
        return platform.processor() or platform.machine()
    import warp as wp

    return str(wp.get_device(args.device).name)


if __name__ == "__main__":
    main()
