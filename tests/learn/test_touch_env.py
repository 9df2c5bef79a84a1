"""The environments fulfil Gymnasium's contract, their rewards are as documented, and standing still loses."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import tci
from tci.capabilities.policy import Observation, PolicySpec, View
from tci.errors import TciError
from tci.learn import WITHDRAWAL, TouchEnv

NAME = "tci/Withdrawal-v0"
Act = Callable[[TouchEnv, np.ndarray], np.ndarray]


def still(env: TouchEnv, seen: np.ndarray) -> np.ndarray:
    return np.zeros(env.action_space.shape or (), np.float32)


def answer(env: TouchEnv, seen: np.ndarray) -> np.ndarray:
    return env.baseline()


def episode(env: TouchEnv, seed: int, act: Act) -> list[dict[str, Any]]:
    """The steps of an episode; checks what holds for every task."""
    seen, info = env.reset(seed=seed)
    terms = set(info) - {"force", "refused", "is_success"}
    rows, over = [], False
    while not over:
        assert env.observation_space.contains(seen)
        seen, reward, terminated, over, info = env.step(act(env, seen))
        assert not terminated
        assert reward == pytest.approx(sum(info[name] for name in terms) / env.policy.rate)
        rows.append({**info, "reward": reward, "seen": seen})
    assert len(rows) == round(env.duration * env.policy.rate)
    return rows


def returns(env: TouchEnv, act: Act, seeds: int) -> float:
    return float(np.mean([sum(row["reward"] for row in episode(env, seed, act)) for seed in range(seeds)]))


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"robot": "icub", "part": "right_arm", "policy": PolicySpec(("posture", "taxels"), mode="impedance")},
        {"task": "hold", "noise": 0.5, "robot": "g1"},
    ],
    ids=["withdrawal", "taxels", "hold"],
)
def test_passes_the_checker_without_a_warning(options: dict[str, Any]) -> None:
    env = TouchEnv(duration=0.2, render_mode="rgb_array", **options)
    env.spec = gymnasium.spec(NAME)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
    assert env.render().shape == (240, 320, 3)


def test_its_name_says_where_it_is_registered() -> None:
    program = (
        f"import gymnasium, sys; gymnasium.make('tci.learn:{NAME}'); gymnasium.make('tci/Hold-v0'); "
        "print('tci.lab.pictures' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"


def test_vectorised_is_the_same_as_alone() -> None:
    alone = gymnasium.make(f"tci.learn:{NAME}", duration=0.1)
    vector = gymnasium.make_vec(NAME, num_envs=2, vectorization_mode="async", duration=0.1)
    vector.action_space.seed(0)
    observations, _ = vector.reset(seed=[3, 4])
    expected, _ = alone.reset(seed=4)
    for _ in range(4):
        np.testing.assert_array_equal(observations[1], expected)
        actions = vector.action_space.sample()
        observations, rewards, *_ = vector.step(actions)
        expected, reward, *_ = alone.step(actions[1])
        assert rewards[1] == pytest.approx(reward, abs=1e-12)
    vector.close()


@pytest.mark.parametrize(("robot", "part"), [("g1-inspire", "left_fingers"), ("icub-whole", "head")])
def test_what_is_no_arm_withdraws_by_the_reflex_of_its_kind(robot: str, part: str) -> None:
    env = TouchEnv(robot, part=part)
    assert returns(env, answer, 2) > 0.8 * returns(env, still, 2)


@pytest.mark.parametrize("robot", ["nao", "icub", "g1"])
@pytest.mark.parametrize("task", ["withdrawal", "hold"])
def test_standing_still_loses_to_the_hand_written_answer(task: str, robot: str) -> None:
    env = TouchEnv(robot, task)
    assert returns(env, answer, 3) > 0.8 * returns(env, still, 3)


def test_standing_still_hurts_and_the_reflex_leaves() -> None:
    env = TouchEnv("nao", "withdrawal")
    home, away = episode(env, 1, still), episode(env, 1, answer)
    touched = [row for row in home if row["force"] > 1.0]
    assert len(touched) > 10
    felt = [10.0 * row["seen"][10 + 4] for row in touched]
    assert np.median(felt) == pytest.approx(np.median([row["force"] for row in touched]), rel=0.3)
    assert home[-1]["away"] > -0.01
    assert away[-1]["force"] == 0.0
    assert away[-1]["away"] < -0.02
    assert sum(row["harm"] for row in away) > 0.5 * sum(row["harm"] for row in home)


def test_a_touch_is_held_at_the_asked_force() -> None:
    env = TouchEnv("g1", "hold")
    for seed in range(2):
        rows = episode(env, seed, answer)
        goal = float(env.scene.goal[0])
        assert rows[-1]["seen"][-1] == np.float32(goal)
        assert np.mean([row["force"] for row in rows[-20:]]) == pytest.approx(goal, rel=0.25)
        assert max(row["force"] for row in rows) > 1.3 * goal, "without yielding it is more"


def on_poles(env: TouchEnv, act: Callable[[], np.ndarray]) -> tuple[bool, dict[str, list[float]]]:
    """Whether the hand reached its place, and the forces of poles on each link and patch, as the physics has
    them."""
    forces, over = dict[str, list[float]](), False
    while not over:
        _, _, _, over, info = env.step(act())
        for one in env.world.meetings():
            robot, pole = sorted((one.first, one.second), key=lambda name: name.startswith("pole "))
            if pole.startswith("pole "):
                forces.setdefault(robot, []).append(one.force)
    return bool(info["is_success"]), forces


@pytest.mark.parametrize(("robot", "seeds"), [("nao", (200, 205)), ("g1", (203, 207)), ("icub", (207, 208))])
def test_an_arm_reaches_through_poles_and_presses_none_hard(robot: str, seeds: tuple[int, ...]) -> None:
    """20 fields of each robot are in docs/learning.md."""
    env = TouchEnv(robot, "reach")
    for seed in seeds:
        env.reset(seed=seed)
        reached, forces = on_poles(env, env.baseline)
        assert reached
        felt = np.concatenate(list(forces.values()))
        assert len(felt) > 10
        assert np.mean(felt < 10.0) > 0.99
    env.reset(seed=seeds[0])
    assert sum(env.step(np.zeros(5))[1] for _ in range(50)) == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("robot", "seed"), [("nao", 200), ("g1", 200), ("icub", 207)])
def test_who_goes_straight_on_through_poles_presses_them_hard_or_stays_behind_them(
    robot: str, seed: int
) -> None:
    env = TouchEnv(robot, "reach")
    env.reset(seed=seed)
    position = env.driver.read().joints.position
    found, _ = env.body.reach("left_arm").solve(env.scene.goal, position)
    place = env.body.posture(replace(env.driver.read().joints, position=found))["left_arm"]

    def straight() -> np.ndarray:
        left = place - env.body.posture(env.driver.read().joints)["left_arm"]
        return left * min(1.0, 0.3 / float(np.abs(left).sum()))

    reached, forces = on_poles(env, straight)
    skin = [name for name in forces if name.startswith("left_") and not name.endswith("_link")]
    assert skin
    assert not reached or max(max(one) for one in forces.values()) > 10.0


def test_same_seed_same_episode_and_another_seed_another() -> None:
    env = TouchEnv(noise=1.0, duration=0.6)

    def told(seed: int) -> list[Any]:
        return [(row["reward"], row["seen"].tobytes()) for row in episode(env, seed, answer)]

    assert told(5) == told(5)
    assert told(5) != told(6)


def test_task_reward_and_what_is_seen_are_functions_that_people_change() -> None:
    def gentle(view: View) -> dict[str, float]:
        return {"load": -sum(one.force for one in view.perception.contacts), "stamp": 0.0}

    mine = replace(
        WITHDRAWAL,
        reward=gentle,
        touch=lambda scene: scene.world.finger.poke("head_skin", 0, depth=0.005),
        reset=lambda scene: scene.world.finger.retire(),
        observations={"load": Observation(lambda view: [view.perception.contacts.force.sum()], scale=2.0)},
        policy=PolicySpec(("load",), rate=20.0, history=2),
    )
    env = TouchEnv("nao-whole", mine, part="head", duration=0.5)
    assert env.policy.joints == tuple(one.name for one in env.robot.part("head").servos)
    assert env.policy.kind == "head"
    seen, _ = env.reset(seed=0)
    for _ in range(10):
        before = seen
        seen, _, _, _, info = env.step(np.zeros(len(env.policy.joints)))
        assert seen[0] == before[1]
    assert seen[1] == pytest.approx(-info["load"] / 2.0, rel=0.2)
    assert info["load"] < -2.0


def test_a_person_touches_as_the_words_say_and_differently_in_each_episode() -> None:
    env = TouchEnv("g1", touches=["press 'left forearm' 0.5s", "hold 'left forearm' with both hands 0.5s"])
    peaks = [max(row["force"] for row in episode(env, seed, still)) for seed in (1, 2, 3, 1)]
    assert min(peaks) > 0.3
    assert peaks[3] == peaks[0]
    assert len(set(peaks)) == 3
    with pytest.raises(TciError, match="g1 has no skin on 'belly'"):
        TouchEnv("g1", touches=["press belly"])


def test_a_period_that_the_robot_can_not_keep_is_a_longer_one() -> None:
    env = TouchEnv(policy=PolicySpec(("velocity",), rate=333.0), rate=500.0)
    env.reset(seed=1)
    before = env.home
    for _ in range(20):
        seen, *_ = env.step([0.0, 0.0, 0.0, 0.3, 0.0])
        now = env.driver.read().joints
        angles = env.body.posture(now)["left_arm"]
        assert 3.0 * seen == pytest.approx((angles - before) / 0.004, abs=1e-4)
        before = angles
    assert env.time == pytest.approx(0.08)


@pytest.mark.parametrize("action", [np.zeros(4), np.full(5, np.nan), 3.0, np.zeros((1, 5))])
def test_a_wrong_action_is_one_error_and_changes_nothing(action: Any) -> None:
    env = TouchEnv(duration=0.2)
    env.reset(seed=1)
    with pytest.raises(TciError, match="valid: 5 finite numbers: shoulder_pitch"):
        env.step(action)
    assert env.time == 0.0


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"task": "dance"}, "withdrawal, hold, reach"), ({"part": "torso"}, "no skin on torso"),
        ({"render_mode": "human"}, "rgb_array"), ({"duration": float("nan")}, "duration"),
        ({"policy": PolicySpec(chunk=2)}, "chunk 2"), ({"policy": PolicySpec(("smell",))}, "smell"),
    ],
)  # fmt: skip
def test_what_can_not_be_is_one_error(options: dict[str, Any], says: str) -> None:
    with pytest.raises(TciError, match=says):
        TouchEnv("nao", **options)


def test_a_policy_sees_the_same_in_the_environment_and_on_the_robot() -> None:
    """Else what was learned is worth nothing there."""
    env, told = TouchEnv("icub", duration=0.6, policy=PolicySpec(rate=25.0, history=3)), []
    seen, _ = env.reset(seed=4)

    def policy(now: np.ndarray) -> np.ndarray:
        told.append(now.astype(np.float32))
        return np.full(5, 0.1)

    capability = tci.PolicyCapability(policy, env.policy, parts=("left_arm",))
    other = TouchEnv("icub", duration=0.6, policy=env.policy)
    other.reset(seed=4)
    memory = capability.init(other.body)
    rows = [seen]
    for n in range(15):
        seen, *_ = env.step(np.full(5, 0.1))
        rows.append(seen)
        for _ in range(4):
            perception = other.seen
            if not other._touched and other.time >= other._due:
                other._touched = True
                other._touch(other.scene)
            orders, memory = capability.step(memory, perception, other.body)
            other._control.act(orders)
            other.time += other.driver.period
            other._look()
        assert len(told) == n + 1
    np.testing.assert_array_equal(told, rows[:-1])
    assert np.any(np.array(told)[:, -28:] > 0.1), "it is touched"
