"""Judges a policy that withdraws: on episodes that it never saw, and by touches of several robots.

python tools/policy.py FILE.onnx [--episodes 200] [--touches 100] [--robots nao,icub,g1] [--via lcm]

Episodes are those of `tci.learn`, beside standing still and the reflex: on the first robot in many worlds, as
it was trained, and on each robot alone, behind the gate. Touches are pokes of both arms near the centres of
the reflex's fields, with 5 to 11 N if nothing moves; the policy runs as a capability, behind the gate. With
--via another process serves the robot in real time, and the policy reaches it over that middleware.
"""

from __future__ import annotations

import argparse
import multiprocessing
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty
from typing import Any

import numpy as np

import tci
from tci.capabilities.fields import default_fields
from tci.capabilities.policy import read_policy
from tci.drivers.registry import connect, open_server
from tci.drivers.simulated import SimulatedDriver
from tci.learn import TouchEnv, TouchVectorEnv
from tci.messages import LimbPlace
from tci.reasons import Code
from tci.runtime.serve import serve
from tci.simulation.finger import Finger

HELD_OUT = 50_000
"""First seed of the episodes; training uses others."""
ONSET = (0.3, 0.8)
LOOKS, RESTS = 1.05, 2.6
"""Time [s] after a contact for which it is judged, and from there to the next touch: by then a policy that
remembers 1.5 s is back."""


def gain_in_worlds(file: str, robot: str, count: int) -> float:
    """How much more the policy gets than who stands still, in the worlds in which it was trained."""
    policy, spec = read_policy(file)
    env, returns = TouchVectorEnv(robot, count, policy=spec), list[float]()
    for still in (True, False):
        seen, _ = env.reset(seed=HELD_OUT)
        total, over = 0.0, False
        while not over:
            acts = [np.zeros(len(spec.joints)) if still else np.ravel(policy(one)) for one in seen]
            seen, rewards, _, ended, _ = env.step(acts)
            total, over = total + float(rewards.mean()), bool(ended.all())
        returns.append(total)
    print(f"{robot}, many worlds: standing still {returns[0]:.4f}, the policy {returns[1]:.4f}", flush=True)
    return returns[1] - returns[0]


def episodes(file: str, robot: str, count: int, trained: float) -> None:
    """Prints returns, harm, peak forces and the motion before the touch, with 95 % intervals, and how much of
    the gain in many worlds, `trained`, is left here."""
    policy, spec = read_policy(file)
    env = TouchEnv(robot, policy=spec)
    returns, found = list[float](), list[Any]()
    acts: dict[str, Callable[[Any], Any]] = {
        "standing still": lambda seen: np.zeros(len(spec.joints)),
        "the reflex": lambda seen: env.baseline(),
        "the policy": policy,
    }
    for name, act in acts.items():
        rows = np.array([episode(env, HELD_OUT + n, act) for n in range(count)])
        returns.append(float(rows[:, 0].mean()))
        found.append(rows)
        words = means(rows)
        before, left = np.rad2deg(rows[:, 3].max()), int(rows[:, 4].sum())
        print(f"{robot}, {name}: {words}; left {left} of {count}; {before:.2f} degrees before", flush=True)
    print(f"{robot}, the policy less the reflex in the same episodes: {means(found[2] - found[1])}")
    print(
        f"{robot}: the policy keeps {(returns[2] - returns[0]) / trained:.0%} of its gain over standing still"
    )


def means(rows: Any) -> str:
    """Means of the first columns over episodes, with 95 % intervals."""
    mean, wide = rows.mean(axis=0), 1.96 * rows.std(axis=0) / np.sqrt(len(rows))
    told = zip(("return", "harm", "peak [N]"), mean, wide, strict=False)
    return ", ".join(f"{what} {here:.4f} +- {half:.4f}" for what, here, half in told)


def episode(env: TouchEnv, seed: int, act: Callable[[Any], Any]) -> tuple[float, ...]:
    """Return, harm, peak force [N], largest motion [rad] before the touch, and 1 if the touch was left."""
    seen, _ = env.reset(seed=seed)
    total, harm, moved, forces, over = 0.0, 0.0, 0.0, list[float](), False
    home, finger = env.driver.read().joints.position, env.world.finger
    while not over:
        seen, reward, _, over, info = env.step(act(seen))
        total, harm = total + reward, harm - info["harm"] / env.policy.rate
        forces.append(info["force"])
        if finger.first_contact is None:
            moved = max(moved, float(np.abs(env.driver.read().joints.position - home).max()))
    touched = np.flatnonzero(forces)
    left = touched.size and 0.0 in forces[touched[0] : touched[0] + round(env.policy.rate)]
    return total, harm, finger.peak_force, moved, float(bool(left))


def poke(driver: SimulatedDriver, chance: np.random.Generator) -> None:
    """Begins a touch near the centre of a field; the finger is on its way for 0.01 to 0.5 s."""
    body, joints, fields = tci.GenericBody(driver.robot), driver.read().joints, default_fields()
    for _ in range(50):
        field, part = fields[chance.integers(len(fields))], str(chance.choice(["left_arm", "right_arm"]))
        u = float(np.clip(field.u + chance.normal(0.0, 0.05), 0.1, 0.9))
        near = LimbPlace(field.segment, u, field.theta + chance.normal(0.0, 0.3))
        how = {"speed": chance.uniform(0.1, 0.4), "depth": chance.uniform(0.006, 0.014)}
        try:
            place = body.place(part, near, joints)
            driver.world.finger.poke(
                place.patch, place.p_L, place.n_L, gap=chance.uniform(0.004, 0.054), **how
            )
            return
        except tci.TciError:  # no skin or no room there
            continue
    raise SystemExit(f"no room for the finger on {driver.robot.name}")


class Judge:
    """Judges one touch after the other from what the physics says."""

    def __init__(self) -> None:
        self.touches = self.left = self.refused = self.orders = self.clamped = self.overtaken = 0
        self.home: Any = None
        self.before = 0.0
        """Largest motion [rad] while nothing touched."""
        self.restart()

    def restart(self, *, looks: bool = True) -> None:
        """For the next touch; with `looks` False, for the pause before it, when the part goes back."""
        self.looks, self.home, self.begun, self.gone = looks, None, np.inf, False

    def see(self, finger: Finger, tick: tci.Tick) -> None:
        force = finger.force
        self.refused += len(tick.sent.refusals)
        self.orders += len(tick.sent.orders)
        self.overtaken += sum(one.code is Code.OVERTAKEN for one in tick.sent.clamped)
        self.clamped += bool(tick.sent.orders) and any(one.code is Code.CLAMPED for one in tick.sent.clamped)
        if not self.looks:
            return
        position = tick.reading.joints.position
        if self.home is None:
            self.home = position
        if force > 0.0 and self.begun == np.inf:
            self.begun = tick.now
        if self.begun == np.inf:
            self.before = max(self.before, float(np.abs(position - self.home).max()))
        self.gone |= force == 0.0 and 0.02 < tick.now - self.begun <= 1.0

    def count(self) -> None:
        self.touches, self.left = self.touches + (self.begun < np.inf), self.left + self.gone

    def __str__(self) -> str:
        degrees = np.rad2deg(self.before)
        return (
            f"left {self.left} of {self.touches}, {degrees:.2f} degrees before; of {self.orders} orders "
            f"{self.refused} refused, {self.clamped} clamped, {self.overtaken} on their way while their part "
            "met something"
        )


def in_simulation(file: str, robot: str, count: int) -> Judge:
    judge, capability = Judge(), tci.PolicyCapability(file)
    for seed in range(count):
        driver = tci.connect(robot, seed=seed)
        poke(driver, np.random.default_rng(seed))
        judge.restart()
        tci.run(driver, capability, duration=1.6, observe=partial(judge.see, driver.world.finger))
        judge.count()
    return judge


def _served(robot: str, via: str, count: int, told: Any) -> None:
    """Serves a robot and touches it again and again."""
    chance, judge, due = np.random.default_rng(0), Judge(), 3.0
    with connect(robot, "sim", paced=True) as driver, open_server(driver, via) as server:
        told.put(server.reach())

        def see(tick: tci.Tick) -> None:
            nonlocal due
            judge.see(driver.world.finger, tick)
            if tick.now < due and tick.now - judge.begun < LOOKS:
                return
            if driver.world.finger.pose is not None:
                judge.count()
                driver.world.finger.retire()
                due = tick.now + RESTS
                judge.restart(looks=False)
                if judge.touches == count:
                    judge.overtaken += server.overtaken
                    told.put(judge)
            elif tick.now >= due:
                poke(driver, chance)
                judge.restart()
                due = tick.now + 2.0

        serve(server, observe=see)


def over(via: str, file: str, robot: str, count: int) -> Judge:
    context = multiprocessing.get_context("spawn")
    told = context.Queue()
    other = context.Process(target=_served, args=(robot, via, count, told))
    other.start()
    refused, judges = 0, list[Judge]()

    def see(tick: tci.Tick) -> None:
        nonlocal refused
        refused += len(tick.sent.refusals)
        with suppress(Empty):
            judges.append(told.get_nowait())
            raise StopIteration

    with connect(robot, told.get(timeout=120.0), arm=True) as driver, suppress(StopIteration):
        tci.run(driver, tci.PolicyCapability(file), observe=see)
    other.terminate()
    print(f"{robot} over {via}: the policy's process counted {refused} refusals")
    return judges[0]


def main() -> None:
    words = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    words.add_argument("file")
    words.add_argument("--episodes", type=int, default=200)
    words.add_argument("--touches", type=int, default=100)
    words.add_argument("--robots", default="nao,icub,g1")
    words.add_argument("--via", default="")
    given = words.parse_args()
    robots = given.robots.split(",")
    if given.episodes:
        trained = gain_in_worlds(given.file, robots[0], given.episodes)
        for robot in robots:
            episodes(given.file, robot, given.episodes, trained)
    for robot in robots if given.touches else ():
        if given.via:
            print(robot, "over", given.via, over(given.via, given.file, robot, given.touches), flush=True)
        else:
            print(robot, "in simulation", in_simulation(given.file, robot, given.touches), flush=True)


if __name__ == "__main__":
    main()
