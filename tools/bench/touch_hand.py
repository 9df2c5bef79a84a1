"""Cost of touch in Gymnasium-Robotics' Shadow hand, which has a block in its palm. Runs in a separate virtual
environment.

Each line of output is one round: the time [us] of a physics step without the 92 touch sensors, then with
these sensors.
"""

from __future__ import annotations

import sys
import time

import gymnasium
import gymnasium_robotics

gymnasium.register_envs(gymnasium_robotics)
NAMES = ("HandManipulateBlock-v1", "HandManipulateBlock_ContinuousTouchSensors-v1")
STEPS = 50
"""Number of steps of the environment in a round."""


def main() -> None:
    environments = [gymnasium.make(name).unwrapped for name in NAMES]
    for environment in environments:
        environment.reset(seed=0)
    action = 0.0 * environments[0].action_space.sample()
    for _ in range(int(sys.argv[1]) + 1):
        times = []
        for environment in environments:
            start = time.thread_time()
            for _ in range(STEPS):
                environment.step(action)
            times.append(1e6 * (time.thread_time() - start) / STEPS / environment.n_substeps)
        print(*times, flush=True)


if __name__ == "__main__":
    main()
