"""Many touched robots in one environment fulfil Gymnasium's contract, and are those of `TouchEnv`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from tci.capabilities.policy import PolicySpec
from tci.errors import TciError
from tci.learn import WITHDRAWAL, TouchEnv, TouchVectorEnv

COUNT, SEED = 2, 100
SEEN = PolicySpec(("offset", "contacts"), rate=25.0, history=2, action_scale=(1.2,) * 5)
YIELD = np.array([0.1, 0.1, 0.0, 0.15, 0.0])


@pytest.fixture(scope="module")
def worlds() -> TouchVectorEnv:
    return TouchVectorEnv("nao", COUNT, policy=SEEN, threads=1)


def episode(env: TouchVectorEnv, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Observations (steps, N, k) and rewards (steps, N) from a new episode on."""
    env.reset(seed=SEED)
    told = [env.step(one) for one in actions]
    assert [over.all() for *_, over, _ in told] == [False] * (len(actions) - 1) + [True]
    return np.array([info.get("final_obs", seen) for seen, *_, info in told]), np.array([r[1] for r in told])


@pytest.mark.parametrize("moves", [False, True], ids=["still", "moving"])
def test_episodes_are_those_of_the_environment_alone(worlds: TouchVectorEnv, moves: bool) -> None:
    steps = 38
    ramp = np.clip(np.arange(steps) / 12.0, 0.0, 1.0)[:, None, None] * YIELD * moves
    actions = np.broadcast_to(ramp, (steps, COUNT, 5))
    seen, rewards = episode(worlds, actions)
    alone = TouchEnv("nao", policy=SEEN)
    touched = 0
    for w in range(COUNT):
        alone.reset(seed=SEED + w)
        rows = [alone.step(one[w]) for one in actions]
        expected = np.array([row[0] for row in rows]).reshape(steps, 2, -1)
        found = seen[:, w].reshape(steps, 2, -1)
        # Of the postures; the gate lets the joints of an arm arrive together, the limiter does not.
        assert np.abs(found[..., :5] - expected[..., :5]).max() < 0.01
        same = np.abs(found[..., 5:] - expected[..., 5:]).max(axis=(1, 2)) < (0.1 if moves else 1e-6)
        assert same.mean() >= 0.8, "but where a contact begins or ends"
        touched += int((expected[:, -1, 5 + 4] > 0.0).sum())
        total = sum(float(row[1]) for row in rows)
        assert rewards[:, w].sum() == pytest.approx(total, rel=0.05 if moves else 0.02)
    assert touched > 10 * COUNT


def test_fulfils_the_contract_of_vector_environments(worlds: TouchVectorEnv) -> None:
    spaces = worlds.observation_space, worlds.action_space
    worlds.action_space.seed(0)
    seen, info = worlds.reset(seed=[7, 8])
    assert worlds.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert info["_force"].all()
    first = seen.copy()
    for k in range(38):
        assert spaces[0].contains(seen)
        seen, rewards, ended, over, info = worlds.step(worlds.action_space.sample())
        assert rewards.shape == ended.shape == over.shape == (COUNT,)
        terms = sum(info[name] for name in ("harm", "effort", "away"))
        np.testing.assert_allclose(rewards, terms / SEEN.rate, rtol=1e-9)
        assert not ended.any()
        assert ("final_obs" in info) == over.all() == over.any() == (k == 37)
    assert np.abs(info["final_obs"][:, -33:-28]).max() > 0.01, "where the arms were"
    assert not seen.any(), "the next episodes begin at home, untouched"
    np.testing.assert_array_equal(worlds.reset(seed=7)[0], first)


def test_is_found_by_its_name_and_its_episodes_are_counted() -> None:
    made = gymnasium.make_vec("tci.learn:tci/Withdrawal-v0", num_envs=2, duration=0.2, threads=1)
    assert isinstance(made, TouchVectorEnv)
    env, ended = RecordEpisodeStatistics(made), list[Any]()
    env.reset(seed=0)
    for _ in range(25):
        info = env.step(np.zeros((2, 5), np.float32))[-1]
        ended += info["episode"]["l"].tolist() if "episode" in info else []
    assert ended == [10, 10, 10, 10]


def test_what_it_does_not_have_is_said(worlds: TouchVectorEnv) -> None:
    with pytest.raises(TciError, match="mode velocity in many worlds; valid: position, or TouchEnv"):
        TouchVectorEnv("nao", 1, "hold")
    with pytest.raises(TciError, match="a task with obstacles in many worlds; valid: "):
        TouchVectorEnv("nao", 1, "reach")
    with pytest.raises(TciError, match="sleep"):
        TouchVectorEnv("nao", 1, "sleep")
    with pytest.raises(TciError, match=r"duration 0.0; valid: above 0"):
        TouchVectorEnv("nao", 1, replace(WITHDRAWAL, duration=0.0))
    with pytest.raises(TciError, match="nao has no skin on torso; valid: "):
        TouchVectorEnv("nao", 1, part="torso")
    with pytest.raises(TciError, match=r"actions of shape \(3, 5\); valid: \(2, 5\), finite"):
        worlds.step(np.zeros((3, 5)))
    with pytest.raises(TciError, match="3 seeds for 2 worlds; valid: one for each, or one number"):
        worlds.reset(seed=[1, 2, 3])
