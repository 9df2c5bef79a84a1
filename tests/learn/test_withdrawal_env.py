"""The environment fulfils Gymnasium's contract, and its rewards are as documented."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tci.capabilities.fields import default_fields
from tci.errors import TciError
from tci.learn import NAME
from tci.learn.withdrawal_env import CONTACTS, WithdrawalEnv
from tci.robot.limb import generic_limb_distance


@pytest.mark.filterwarnings("ignore:.*Box observation space.*:UserWarning")
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"robot": "icub", "part": "right_arm", "touch": "taxels"},
        {"mode": "velocity"},
        {"mode": "impedance", "noise": 0.5},
    ],
    ids=["contacts", "taxels", "velocity", "impedance"],
)
@pytest.mark.filterwarnings("error:.*obs returned by.*")
def test_passes_the_checker(options: dict[str, object]) -> None:
    env = gymnasium.make(NAME, duration=0.2, render_mode="rgb_array", **options)
    check_env(env.unwrapped, skip_render_check=False)
    env.close()


def test_its_name_says_where_it_is_registered() -> None:
    program = (
        f"import gymnasium, sys; gymnasium.make('tci.learn:{NAME}'); print('tci.lab.pictures' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_vectorised_is_the_same_as_alone(mode: str) -> None:
    alone = gymnasium.make(NAME, duration=0.1)
    vector = gymnasium.make_vec(NAME, num_envs=2, vectorization_mode=mode, duration=0.1)
    vector.action_space.seed(0)
    observations, _ = vector.reset(seed=[3, 4])
    expected, _ = alone.reset(seed=4)
    for _ in range(4):
        for name, value in expected.items():
            np.testing.assert_array_equal(observations[name][1], value)
        actions = vector.action_space.sample()
        observations, rewards, *_ = vector.step(actions)
        expected, reward, *_ = alone.step(actions[1])
        assert rewards[1] == pytest.approx(reward, abs=1e-12)
    vector.close()


Policy = Callable[[dict[str, np.ndarray]], np.ndarray]


def stay(observation: dict[str, np.ndarray]) -> np.ndarray:
    return observation["task"]


class Withdraw:
    """The reflex as a policy: the first contact determines the direction."""

    def __init__(self) -> None:
        self.motion = np.zeros(5)

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        forearm, u, sin, cos, force, *_ = observation["contacts"][0]
        if force > 0.5 and not self.motion.any():
            near = [
                (generic_limb_distance(u, np.arctan2(sin, cos), field.u, field.theta), field.motion)
                for field in default_fields()
                if (field.segment == "forearm") == (forearm > 0.5)
            ]
            self.motion = np.array(min(near)[1])
        return observation["task"] + self.motion


def episode(env: WithdrawalEnv, seed: int, policy: Policy) -> list[dict[str, float]]:
    observation, _ = env.reset(seed=seed)
    rows, done = [], False
    while not done:
        observation, reward, terminated, done, info = env.step(policy(observation))
        assert not terminated
        cost = info["harm"] + 0.05 * info["effort"] + info["task"]
        assert reward == pytest.approx(-env.period * cost)
        felt = observation["contacts"][:, 4]
        rows.append({**info, "felt": float(felt[0])})
    return rows


@pytest.fixture(scope="module")
def env() -> WithdrawalEnv:
    return WithdrawalEnv(step=0.001)


def test_holding_still_hurts_and_the_touch_is_seen(env: WithdrawalEnv) -> None:
    rows = episode(env, 1, stay)
    assert len(rows) == round(env.duration / env.period)
    touched = [row for row in rows if row["force"] > 1.0]
    assert len(touched) > 10
    assert max(row["harm"] for row in rows) > 0.05
    assert sum(row["felt"] > 0.5 for row in touched) > 0.8 * len(touched)
    assert all(row["task"] < 0.1 for row in rows)


@pytest.mark.parametrize("seed", [2, 3])
def test_the_reflex_ends_the_harm_and_costs_effort_and_task(env: WithdrawalEnv, seed: int) -> None:
    home, away = episode(env, seed, stay), episode(env, seed, Withdraw())
    assert sum(row["harm"] for row in away) < 0.5 * sum(row["harm"] for row in home)
    assert sum(row["effort"] for row in away) > sum(row["effort"] for row in home)
    assert away[-1]["task"] > home[-1]["task"] + 0.05


def test_same_seed_same_episode(env: WithdrawalEnv) -> None:
    assert episode(env, 5, stay) == episode(env, 5, stay)
    assert episode(env, 5, stay) != episode(env, 6, stay)


def test_a_person_touches_as_the_words_say_and_differently_in_each_episode() -> None:
    env = WithdrawalEnv(
        "g1", touches=["press 'left forearm' 0.5s", "hold 'left forearm' with both hands 0.5s"]
    )
    peaks = []
    for seed in (1, 2, 3, 1):
        seen, _ = env.reset(seed=seed)
        steps = [env.step(seen["task"]) for _ in range(60)]
        assert max(one[0]["contacts"][0, 4] for one in steps) > 0.3
        peaks.append(max(one[4]["force"] for one in steps))
    assert peaks[3] == peaks[0]
    assert len(set(peaks)) == 3
    with pytest.raises(TciError, match="no skin of g1 at a place named 'belly'"):
        WithdrawalEnv("g1", touches=["press belly"])


def test_noise_is_another_in_each_episode_and_the_same_for_a_seed() -> None:
    env = WithdrawalEnv(touch="taxels", noise=2.0, duration=0.1)
    seeds = (1, 2, 1, None, None)
    felt = []
    for seed in seeds:
        env.reset(seed=seed)
        felt.append(env.step(env._task)[0]["taxels"].tobytes())
    assert felt[0] == felt[2]
    assert len(set(felt)) == 4


def test_a_period_that_the_robot_can_not_keep_is_a_longer_one() -> None:
    """Commands are sent every 2 ms. Velocity and reward refer to the time that really passed."""
    env = WithdrawalEnv(period=0.003, rate=500.0)
    assert env.metadata["render_fps"] == 333
    observation, _ = env.reset(seed=1)
    target = observation["task"] + [0.0, 0.0, 0.0, 0.3, 0.0]
    before = observation["posture"]
    for _ in range(20):
        observation, reward, _, _, info = env.step(target)
        assert observation["velocity"] == pytest.approx((observation["posture"] - before) / 0.004, abs=1e-9)
        assert reward == pytest.approx(-0.004 * (info["harm"] + 0.05 * info["effort"] + info["task"]))
        before = observation["posture"]
    assert env.time == pytest.approx(0.08)


def test_taxels_and_contacts_have_the_declared_shapes() -> None:
    env = WithdrawalEnv("nao", touch="taxels")
    observation, _ = env.reset(seed=0)
    assert observation["taxels"].shape == (360,)
    assert WithdrawalEnv("nao").observation_space["contacts"].shape == (CONTACTS, 7)


@pytest.mark.parametrize(
    "options",
    [
        {"mode": "torque"}, {"touch": "forces"}, {"part": "torso"}, {"pain": 0.0}, {"render_mode": "human"},
        {"period": 0.0}, {"duration": float("nan")},
    ],
)  # fmt: skip
def test_what_can_not_be_is_one_error(options: dict[str, object]) -> None:
    with pytest.raises(TciError):
        WithdrawalEnv("nao", **options)
