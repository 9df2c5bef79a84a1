"""Checks every ready environment as stable-baselines3 does, and films an episode with RecordVideo.

python tools/environments.py, in the environment of `make learn`; a warning is an error.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium
from gymnasium.wrappers import RecordVideo
from stable_baselines3.common.env_checker import check_env

from tci.learn import TASKS, TouchEnv


def main() -> None:
    for task in TASKS:
        for robot in ("nao", "icub", "g1"):
            env = TouchEnv(robot, task, duration=0.3, render_mode="rgb_array")
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                check_env(env)
            print(f"{task} on {robot}: check_env of stable-baselines3 finds nothing", flush=True)
    with TemporaryDirectory() as folder:
        made = gymnasium.make("tci.learn:tci/Withdrawal-v0", duration=0.3, render_mode="rgb_array")
        film = RecordVideo(made, str(Path(folder) / "films"))
        film.reset(seed=1)
        over = False
        while not over:
            *_, over, _ = film.step(film.action_space.sample())
        film.close()
        (file,) = Path(folder, "films").glob("*.mp4")
        print(f"RecordVideo: {file.name}, {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
