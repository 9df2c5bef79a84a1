"""Shows genuine LeRobot with robots of TCI: it finds the plug-in, records hands that guide an arm, and loads
the set.

python tools/with_lerobot.py [--robots nao,icub,g1] [--episodes 2] [--via zenoh] [--out out/lerobot], in the
environment of `make lerobot`, or in one of LeRobot 0.6.1.
"""

from __future__ import annotations

import argparse
import os
import runpy
import shlex
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import numpy as np

FPS, SECONDS = 30, 3.0
TOUCH = "push 'left forearm' 5N 0.9s"
TASK = "Go where the hand pushes"
COMMANDS = {
    "record": "lerobot.scripts.lerobot_record",
    "train": "lerobot.scripts.lerobot_train",
    "eval": "lerobot.scripts.lerobot_eval",
    "edit": "lerobot.scripts.lerobot_edit_dataset",
}


def complete_torchvision() -> None:
    """PyPI's torchvision is built for CUDA, and beside a CPU build of PyTorch it fails at its first operator.
    What data sets and ACT need of it works once the schemas of two operators exist."""
    import torch

    if "+cpu" in torch.__version__ and "+cpu" not in version("torchvision"):
        library = torch.library.Library("torchvision", "DEF")
        complete_torchvision.library = library  # it lives as long as the operators
        for name in ("nms", "qnms"):
            library.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")


def lerobot(command: str, *arguments: str) -> None:
    """Runs a command of LeRobot in a process of its own."""
    subprocess.run([sys.executable, __file__, "command", command, *arguments], check=True)


@contextmanager
def reached(robot: str, via: str) -> Iterator[list[str]]:
    """The options with which LeRobot reaches a robot that people touch: simulated by its own process, or over
    a middleware, for which another process serves it in real time."""
    if via == "sim":
        yield [f'--robot.touches=["{TOUCH}"]']
        return
    tci = Path(sys.executable).with_name("tci")
    serve = [tci, "serve", robot, "--via", via, "--touch", TOUCH]
    with subprocess.Popen(
        serve, stdout=subprocess.PIPE, text=True, env={**os.environ, "COLUMNS": "500"}
    ) as other:
        assert other.stdout is not None
        try:
            words = next(line for line in other.stdout if "to use it" in line)
            address = shlex.split(words)[shlex.split(words).index("--via") + 1]
            threading.Thread(target=other.stdout.read, daemon=True).start()
            yield [f"--robot.via={address}", "--robot.arm=true"]
        finally:
            other.terminate()


def record(robot: str, root: Path, episodes: int, options: list[str]) -> None:
    lerobot(
        "record", "--robot.type=tci", f"--robot.robot={robot}", f"--robot.fps={FPS}", *options,
        "--teleop.type=tci_touch",
        f"--dataset.repo_id=tci/{robot}", f"--dataset.root={root}", f"--dataset.fps={FPS}",
        f"--dataset.single_task={TASK}",
        f"--dataset.num_episodes={episodes}", f"--dataset.episode_time_s={SECONDS}",
        "--dataset.reset_time_s=0.5", "--dataset.push_to_hub=false", "--play_sounds=false",
    )  # fmt: skip


def judge(robot: str, root: Path, episodes: int) -> None:
    """Loads the set as LeRobot does, and says what is in it."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    data = LeRobotDataset(f"tci/{robot}", root=root)
    names = data.meta.features["observation.state"]["names"]
    rows = [data[n] for n in range(len(data))]
    state = np.stack([row["observation.state"].numpy() for row in rows])
    action = np.stack([row["action"].numpy() for row in rows])
    whose = np.array([int(row["episode_index"]) for row in rows])
    force = state[:, [n for n, name in enumerate(names) if name.endswith("contact0.force")]].max(axis=1)
    moved = [np.rad2deg(np.ptp(action[whose == n], axis=0).max()) for n in range(episodes)]
    if set(whose) != {*range(episodes)} or force.max() < 0.5 or not any(one > 5.0 for one in moved):
        raise SystemExit(f"{robot}: episodes {set(whose)}, {force.max():.1f} N, moved {moved} degrees")
    told = ", ".join(f"{one:.0f}" for one in moved)
    print(
        f"{robot}: LeRobot loads {data.num_episodes} episodes, {len(data)} rows of {len(names)} numbers; "
        f"a hand pushed with up to {force.max():.1f} N, the arm was guided by {told} degrees",
        flush=True,
    )


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--robots", default="nao,icub,g1")
    words.add_argument("--episodes", type=int, default=2)
    words.add_argument("--via", default="sim", help="such as zenoh: another process serves the robot")
    words.add_argument("--out", type=Path, default=Path("out/lerobot"))
    given = words.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    # nothing is written to the home folder, nothing is fetched
    home = given.out.resolve() / "home"
    os.environ |= {"HF_HUB_OFFLINE": "1", "HF_HOME": str(home), "HF_LEROBOT_HOME": str(home / "lerobot")}
    complete_torchvision()
    for robot in given.robots.split(","):
        root = given.out / robot
        shutil.rmtree(root, ignore_errors=True)
        with reached(robot, given.via) as options:
            record(robot, root, given.episodes, options)
        judge(robot, root, given.episodes)


if __name__ == "__main__":
    if sys.argv[1:2] == ["command"]:
        complete_torchvision()
        module = COMMANDS[sys.argv[2]]
        sys.argv = [module, *sys.argv[3:]]
        runpy.run_module(module, run_name="__main__")
    else:
        main()
