"""The closed form of a motion from rest to rest equals the trajectories that ruckig plans."""

from __future__ import annotations

import numpy as np
import pytest
from ruckig import InputParameter, Ruckig, Synchronization, Trajectory

from tci.body.kernels.rest_to_rest import EARLY, SHARES, TIMES, Speeds, predict
from tci.messages.frames import frozen

JOINTS = 5


@pytest.mark.parametrize("together", [True, False])
def test_the_path_is_ruckigs(together: bool) -> None:
    random, planner = np.random.default_rng(0), Ruckig(JOINTS)
    plan, trajectory = InputParameter(JOINTS), Trajectory(JOINTS)
    plan.synchronization = Synchronization.Time if together else Synchronization.No
    plan.current_position = [0.0] * JOINTS
    for _ in range(3000):
        speed, acceleration, jerk = (10.0 ** random.uniform(low, low + 3.0, JOINTS) for low in (-1, -1, 1))
        goal = random.uniform(-2.0, 2.0, JOINTS) * random.choice([1.0, 0.1, 0.01, 0.0], JOINTS)
        plan.target_position, plan.max_velocity = goal.tolist(), speed.tolist()
        plan.max_acceleration, plan.max_jerk = acceleration.tolist(), jerk.tolist()
        planner.calculate(plan, trajectory)
        moments = [*EARLY, *(share * trajectory.duration for share in SHARES)]
        expected = np.array([trajectory.at_time(moment)[0] for moment in moments])
        way = np.zeros((TIMES + 1, JOINTS))
        predict(
            way, np.arange(JOINTS), goal, Speeds(frozen(speed), frozen(acceleration), frozen(jerk)), together
        )
        np.testing.assert_allclose(way[1:], expected, rtol=1e-6, atol=1e-7)
        assert not way[0].any()


def test_servos_that_do_not_move_keep_their_angles() -> None:
    limits = [frozen(np.ones(1))] * 3
    way = np.tile([1.0, 2.0, 3.0], (TIMES + 1, 1))
    predict(way, np.array([1]), np.array([2.5]), Speeds(*limits), True)
    assert (way[:, [0, 2]] == [1.0, 3.0]).all()
    assert (np.diff(way[:, 1]) > 0.0).all()
    assert way[-1, 1] == 2.5
