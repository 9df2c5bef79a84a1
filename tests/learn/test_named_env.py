"""What is recorded of a robot and what policies are judged in have the same numbers (in LeRobot itself:
`make lerobot`)."""

from __future__ import annotations

import numpy as np
import pytest

from tci.errors import TciError
from tci.learn import NamedEnv, NamedRobot


def test_what_was_recorded_with_a_robot_is_judged_in_the_same_numbers() -> None:
    env = NamedEnv("nao", parts=["left_arm"], fps=30.0, picture=(40, 30))
    with NamedRobot("nao", parts=["left_arm"]) as robot:
        assert (env.observed, env.actions) == (robot.observed, robot.actions)
        recorded = robot.observe()
        rest = {name: recorded[name] for name in robot.actions}
    seen, _ = env.reset(seed=1)
    assert dict(zip(env.observed, seen["agent_pos"], strict=True)) == pytest.approx(recorded, abs=1e-3)
    place = env.observed.index("left_arm.shoulder_roll.pos")
    force = env.observed.index("left_arm.contact0.force")
    begun, forces, totals, over = seen["agent_pos"][place], [], [], False
    while not over:
        assert env.observation_space.contains(seen)
        away = 0.5 * bool(forces and max(forces) > 0.5)
        angles = np.array([*rest.values()]) + away * (np.array(env.actions) == "left_arm.shoulder_roll.pos")
        seen, _, _, over, info = env.step(angles)
        forces.append(float(seen["agent_pos"][force]))
        totals.append(float(seen["environment_state"].sum()))
    assert len(forces) == 45, "1.5 s at 30 frames per second"
    assert max(forces) > 0.5
    assert max(totals) == pytest.approx(max(forces), rel=0.2), "a contact counts gaps between taxels too"
    assert totals[0] == 0.0
    assert seen["agent_pos"][place] - begun == pytest.approx(0.5, abs=0.05)
    assert info["is_success"] == (forces[-1] == 0.0)


def test_who_stands_still_fails_and_a_wrong_action_is_one_error() -> None:
    env = NamedEnv("nao", parts=["left_arm"], fps=10.0)
    seen, _ = env.reset(seed=1)
    rest, over = [seen["agent_pos"][env.observed.index(name)] for name in env.actions], False
    with pytest.raises(TciError, match=r"for each of left_arm\.shoulder_pitch"):
        env.step(rest[1:])
    while not over:
        _, _, _, over, info = env.step(rest)
    assert not info["is_success"]
    with pytest.raises(TciError, match="fps 0"):
        NamedEnv("nao", fps=0.0)
