"""Trains LeRobot's ACT to withdraw, on sets that TCI wrote, and judges it in `lerobot-eval` and by touches.

python tools/act.py [--robots nao,icub,g1] [--episodes 60] [--steps 2000] [--touches 20] [--out out/act],
in the environment of `make lerobot`. On each robot the reflex is recorded while a finger pokes it, ACT learns
from the set that TCI makes of it, and held-out touches in `--env.type=tci` judge what it learned.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from with_lerobot import complete_torchvision, lerobot

import tci
from tci.datasets import read_set, write_lerobot
from tci.learn import NamedEnv, Scene
from tci.learn.task import Poke, felt_part

FPS, SECONDS, HELD_OUT = 30, 2.4, 50_000
ONSET = (1.2, 1.7)
"""Time [s] of the touch in a recording: more than half of its rows are at rest, so that is what an L1 loss
makes of rows without a touch."""
SMALL = ("dim_model=64", "n_heads=4", "dim_feedforward=128", "n_encoder_layers=2", "use_vae=false",
         "chunk_size=12", "n_action_steps=6", "dropout=0",
         'normalization_mapping={"STATE": "IDENTITY", "ENV": "IDENTITY", "ACTION": "IDENTITY"}')  # fmt: skip
"""A small ACT, of angles [rad] and forces [N] as they are: joints that rest in all recordings have a standard
deviation of 4e-6 rad or 0, and divided by that, nothing becomes a hundred times what training saw."""
RATE = 1e-3
"""Learning rate at first; it ends at 0. At a constant rate, and with dropout, orders at rest are a bit off.
Near rest the recordings have nothing but the beginning of a withdrawal, so ACT goes on in that direction."""
COLUMNS = ("observation.state", "observation.environment_state", "action")
"""What ACT learns from: that of LeRobot 0.4.4 can't do without a state."""
STILL, MOVES, CHANGES = np.deg2rad(2.0), np.deg2rad(5.0), np.deg2rad(2.0)
"""Largest motion [rad] before a touch, least motion within 1 s after it, and least change of the action when
the forces are set to 0: the bar."""


def record(robot: str, folder: Path, episodes: int) -> None:
    """Records pokes of one part, each answered by the reflex."""
    for number in range(episodes):
        chance = np.random.default_rng(number)
        about = {"task": "withdraw from the touch"}
        with (
            tci.connect(robot, seed=number) as driver,
            tci.Recorder(folder / f"{number:03d}.mcap", driver.robot, about=about) as recorder,
        ):
            scene = Scene(driver.world, tci.GenericBody(driver.robot), felt_part(driver.robot), chance)
            see = partial(_recorded, recorder, scene, [chance.uniform(*ONSET)])
            tci.run(driver, tci.WithdrawalReflex(), duration=SECONDS, observe=see)


def _recorded(recorder: tci.Recorder, scene: Scene, due: list[float], tick: tci.Tick) -> None:
    if due and tick.now >= due[0]:
        due.clear()
        Poke()(scene)
    recorder.tick(tick.now, tick.reading, tick.commands, tick.sent)


def train(robot: str, data: Path, out: Path, steps: int) -> None:
    lerobot(
        "train", f"--dataset.repo_id=tci/{robot}", f"--dataset.root={data}", "--policy.type=act",
        *(f"--policy.{one}" for one in SMALL), "--policy.device=cpu", "--policy.push_to_hub=false",
        "--use_policy_training_preset=false", "--optimizer.type=adamw", "--optimizer.weight_decay=1e-4",
        f"--optimizer.lr={RATE}", "--scheduler.type=cosine_decay_with_warmup", f"--scheduler.peak_lr={RATE}",
        "--scheduler.decay_lr=0", "--scheduler.num_warmup_steps=100", f"--scheduler.num_decay_steps={steps}",
        f"--output_dir={out}", f"--steps={steps}", f"--save_freq={steps}", "--batch_size=32",
        "--num_workers=0", "--log_freq=200", "--wandb.enable=false",
    )  # fmt: skip


@dataclass
class Judged:
    """How one touch went."""

    before: float
    """Largest motion [rad] of a joint before it."""
    after: float
    """Largest motion [rad] within 1 s of it."""
    change: float
    """By how much [rad] the action changes at most when the forces are set to 0."""


class Act:
    """The trained policy, as LeRobot runs it."""

    def __init__(self, folder: Path) -> None:
        from lerobot.policies.act.modeling_act import ACTPolicy
        from lerobot.policies.factory import make_pre_post_processors

        self.policy = ACTPolicy.from_pretrained(folder)
        self.policy.eval()
        self._before, self._after = make_pre_post_processors(self.policy.config, str(folder))

    def _batch(self, seen: dict[str, Any]) -> Any:
        from lerobot.envs.utils import preprocess_observation

        return self._before(preprocess_observation({name: one[None] for name, one in seen.items()}))

    def __call__(self, seen: dict[str, Any]) -> Any:
        import torch

        with torch.inference_mode():
            return self._after(self.policy.select_action(self._batch(seen))).numpy()[0]

    def chunk(self, seen: dict[str, Any]) -> Any:
        import torch

        with torch.inference_mode():
            found = self.policy.predict_action_chunk(self._batch(seen))
            return self._after(found).numpy()[0, : self.policy.config.n_action_steps]


def touch(env: NamedEnv, act: Act, seed: int) -> Judged:
    seen, _ = env.reset(seed=seed)
    act.policy.reset()
    places = [env.observed.index(name) for name in env.actions]
    home, begun, time_now, over = seen["agent_pos"][places], np.inf, 0.0, False
    judged = Judged(0.0, 0.0, 0.0)
    while not over:
        none = seen | {"environment_state": np.zeros_like(seen["environment_state"])}
        if begun < np.inf:
            judged.change = max(judged.change, float(np.abs(act.chunk(seen) - act.chunk(none)).max()))
        seen, _, _, over, info = env.step(act(seen))
        time_now += 1.0 / FPS
        if info["force"] > 0.0:
            begun = min(begun, time_now)
        moved = float(np.abs(seen["agent_pos"][places] - home).max())
        if begun == np.inf:
            judged.before = max(judged.before, moved)
        elif time_now <= begun + 1.0:
            judged.after = max(judged.after, moved)
    return judged


def one(robot: str, out: Path, given: argparse.Namespace) -> bool:
    """Whether the bar is met on a robot."""
    shutil.rmtree(out, ignore_errors=True)
    (out / "recordings").mkdir(parents=True)
    record(robot, out / "recordings", given.episodes)
    write_lerobot(
        read_set(sorted((out / "recordings").glob("*.mcap")), fps=FPS), out / "set", columns=COLUMNS
    )
    begun = time.monotonic()
    train(robot, out / "set", out / "act", given.steps)
    print(f"{robot}: {given.steps} steps of training took {time.monotonic() - begun:.0f} s", flush=True)
    model = out / "act" / "checkpoints" / "last" / "pretrained_model"
    lerobot(
        "eval", f"--policy.path={model}", "--policy.device=cpu", "--env.type=tci", f"--env.robot={robot}",
        '--env.parts=["all"]', '--env.observations=["posture"]', f"--env.fps={FPS}",
        f"--env.duration={SECONDS}", "--eval.n_episodes=2", "--eval.batch_size=1", f"--seed={HELD_OUT}",
        f"--output_dir={out / 'eval'}",
    )  # fmt: skip
    told = json.loads((out / "eval" / "eval_info.json").read_text())
    print(f"{robot}: lerobot-eval says {told['overall']}", flush=True)
    env, act = NamedEnv(robot, parts=["all"], observations=["posture"], fps=FPS, duration=SECONDS), Act(model)
    rows = [touch(env, act, HELD_OUT + n) for n in range(given.touches)]
    calm = sum(row.before < STILL for row in rows)
    left = sum(row.before < STILL and row.after > MOVES for row in rows)
    changed = sum(row.change > CHANGES for row in rows)
    print(
        f"{robot}, {len(rows)} held-out touches: {calm} found it within 2 degrees of its start, of these "
        f"{left} moved it by more than 5 degrees within 1 s; in {changed} the action changed by more than 2 "
        "degrees without the forces",
        flush=True,
    )
    return 4 * min(left, changed) >= 3 * len(rows)


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("--robots", default="nao,icub,g1")
    words.add_argument("--episodes", type=int, default=60)
    words.add_argument("--steps", type=int, default=2000)
    words.add_argument("--touches", type=int, default=20)
    words.add_argument("--out", type=Path, default=Path("out/act"))
    given = words.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    home = given.out.resolve() / "home"  # nothing is written to the home folder, nothing is fetched
    os.environ |= {"HF_HUB_OFFLINE": "1", "HF_HOME": str(home), "HF_LEROBOT_HOME": str(home / "lerobot")}
    complete_torchvision()
    met = {robot: one(robot, given.out / robot, given) for robot in given.robots.split(",")}
    if missed := [robot for robot, good in met.items() if not good]:
        raise SystemExit(f"not met on {', '.join(missed)}: left, and changed without the forces, in 3 of 4")


if __name__ == "__main__":
    main()
