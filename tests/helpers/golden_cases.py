"""Golden recordings: runs of an earlier version with their descriptions, which replay must reproduce.

`python -m helpers.golden_cases NAME...` in `tests/` records cases again ("all": all of them). Do this only
after an intended change of behaviour, and mention the change in the commit message.
`... perceived NAME...` keeps the recordings with their decisions, and computes their perceptions again.

Most cases use the paper's reflex with the force of equation 7. Cases with "total" in their name use the
default measure of force.
"""

from __future__ import annotations

import atexit
import shutil
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

import tci
from helpers import TESTS
from helpers.rehearsal import Sway
from helpers.turning import Turn
from tci.body.generic_body import GenericBody
from tci.capabilities import default_fields
from tci.capabilities.behaviour_tree import BehaviourTree, Reflex, Task
from tci.capabilities.body_withdrawal import BodyWithdrawal
from tci.cli.session import poke_skin
from tci.drivers.driver import Driver
from tci.drivers.replay import ReplayDriver
from tci.drivers.simulated import SimulatedDriver
from tci.gestures.gesture import Fitted, Gesture
from tci.lab.faults.fault_injector import FaultInjector, FaultPlan
from tci.lab.faults.injectors import INJECTORS
from tci.lab.viewer.steered import Steered
from tci.messages import GenericCommand, Mode, Perception
from tci.recording.recorder import Recorder
from tci.robot.catalogue import load_robot
from tci.robot.description import Robot
from tci.runtime.loop import Tick, run

FOLDER = TESTS / "golden"
AT = 0.34
"""Time [s] of a fault, while the arm withdraws."""
NOT_RECORDED = ("sigterm", "thread-fails", "link-lost", "wrong-type")
"""Injectors without effect on these recordings: the end of a process, a thread or a connection, and text
instead of numbers, which format 1 can't contain."""


def paper() -> tci.WithdrawalReflex:
    """Returns the reflex of the paper, which uses the force of equation 7."""
    return tci.WithdrawalReflex(fields=default_fields(measure="weighted"), response="meant")


def gesture() -> tci.Arbiter:
    """An arm that swings, and a reflex that interrupts it. Not fitted, since a fit rounds too."""
    times = np.linspace(0.0, 0.8, 17)
    swing = np.outer(np.sin(np.pi * times / 0.8), [0.3, 0.0, 0.0, 0.2, 0.0])
    arm = Gesture(times, {"left_arm": np.deg2rad([25.0, 25.0, 0.0, 60.0, 0.0]) + swing})
    reflex = tci.WithdrawalReflex(refractory=0.2)
    return tci.Arbiter([reflex, tci.PlayGesture(Fitted(arm, arm, 1.0, {}, ()))])


def tree() -> tci.Capability[Any]:
    """A reflex above a task on the same arms."""
    from py_trees.composites import Selector

    reflex, sway = tci.WithdrawalReflex(refractory=0.2), Sway()

    def root() -> Selector:
        task = Task("sway", sway, done=lambda memory, perception: False)
        return Selector("robot", memory=False, children=[Reflex("withdraw", reflex), task])

    return BehaviourTree(root)


class Turned(Steered):
    """A person turns the head, as with the viewer, while the inner reflex withdraws an arm."""

    def step(self, memory: Any, perception: Perception, body: GenericBody) -> tuple[tuple[Any, ...], Any]:
        if 0.1 <= perception.stamp < 0.11:
            self.orders.put(GenericCommand("head", Mode.POSITION, np.array([0.2, 0.0, 0.1])))
        return super().step(memory, perception, body)


def arbiter() -> tci.Arbiter:
    """A reflex that aims at positions above a task that commands velocities."""
    return tci.Arbiter([tci.WithdrawalReflex(refractory=0.2), Turn()])


def poke_palm(driver: SimulatedDriver) -> None:
    driver.world.finger.poke("left_palm", 13, speed=0.2, depth=0.003)


def poke_head(driver: SimulatedDriver) -> None:
    driver.world.finger.poke("head_skin", 10, speed=0.2, depth=0.008, gap=0.02)


@dataclass(frozen=True)
class Case:
    """One recorded run."""

    robot: str
    """Path of the robot's description, below `robots/`."""
    capability: Callable[[], tci.Capability[Any]] = paper
    poke: Callable[[SimulatedDriver], None] | None = poke_skin
    duration: float = 0.7
    """Duration [s]."""
    keep_alive: float | None = None
    """Longest time [s] between two frames of a patch whose frames are sent only on change; None if every
    frame is sent."""
    flicker: float = 0.0
    """Noise [counts] on all raw values, which are then sent as float64."""
    fault: str = ""
    """Name of the injector that starts at `AT`; empty for none."""
    ends: float = np.inf
    """Time [s] at which the finger is taken away."""


CASES: dict[str, Case] = {
    "nao": Case("nao/robot.xml"),
    "icub": Case("icub/robot.xml"),
    "nao-total": Case("nao/robot.xml", tci.WithdrawalReflex),
    "icub-total": Case("icub/robot.xml", tci.WithdrawalReflex),
    "body": Case("icub/whole.xml", BodyWithdrawal, poke_head, duration=0.6),
    "events": Case("nao/robot.xml", keep_alive=0.1),
    "soft-velocity": Case("nao/robot.xml", tci.SoftReaction, duration=0.5, ends=0.35),
    "soft-torque": Case("icub/robot.xml", lambda: tci.SoftReaction(mode="torque"), duration=0.4),
    "grasp": Case(
        "nao-hands/hands.xml", lambda: tci.LightGrasp(quiet=0.15), poke_palm, duration=0.6, ends=0.3
    ),
    "contact-stop": Case(
        "nao/robot.xml", lambda: tci.ContactStop(Sway(), quiet=0.15), duration=0.6, ends=0.3
    ),
    "gesture": Case("nao/robot.xml", gesture, duration=1.3, ends=0.4),
    "arbiter": Case("nao/robot.xml", arbiter, duration=0.7, ends=0.35),
    "tree": Case("nao/robot.xml", tree, duration=0.8, ends=0.35),
    "steered": Case("nao/robot.xml", lambda: Turned(tci.WithdrawalReflex()), duration=0.4),
    "three-axes": Case("nao/three_axes.xml"),
    "flicker": Case("nao/robot.xml", flicker=1.0, duration=0.8),
    **{
        f"sway-{mode.value}": Case("icub/robot.xml", lambda mode=mode: Sway(mode), None, duration=0.4)
        for mode in (Mode.POSITION, Mode.TORQUE, Mode.IMPEDANCE)
    },
    **{
        f"fault-{name}": Case("nao/robot.xml", fault=name, duration=0.6)
        for name in INJECTORS
        if name not in NOT_RECORDED
    },
}


@cache
def described(robot: str) -> Robot:
    """Returns the robot of a description that was used for a recording, with the digest of the original file.
    The files are copied, because the recorded descriptions contain `origin="ours"`, which the reader no
    longer accepts."""
    folder = Path(mkdtemp())
    atexit.register(shutil.rmtree, folder)
    shutil.copytree(FOLDER / "robots", folder, dirs_exist_ok=True)
    recorded = (folder / robot).read_bytes()
    (folder / robot).write_bytes(recorded.replace(b'origin="ours"', b'origin="assumed"'))
    return load_robot(str(folder / robot)).model_copy(update={"digest": sha256(recorded).hexdigest()})


def record(name: str) -> None:
    """Records a case, together with its perceptions."""
    case, path = CASES[name], FOLDER / f"{name}.mcap"
    path.unlink(missing_ok=True)
    ticks: list[Tick] = []
    with SimulatedDriver(described(case.robot), keep_alive=case.keep_alive) as simulated:
        driver: Driver = simulated
        if case.fault or case.flicker:
            plans = [FaultPlan(case.fault, AT)] if case.fault else []
            driver = FaultInjector(simulated, plans, flicker=case.flicker)
        with Recorder(
            path, driver.robot, period=driver.period, keep_alive=driver.info.keep_alive
        ) as recorder:
            if case.poke is not None:
                case.poke(simulated)

            def see(tick: Tick) -> None:
                ticks.append(tick)
                if tick.now >= case.ends:
                    simulated.world.finger.retire()
                recorder.tick(tick.now, tick.reading, tick.commands, tick.sent)

            run(driver, case.capability(), duration=case.duration, observe=see)
    np.savez_compressed(FOLDER / f"{name}.npz", **perceived(ticks))


def replayed(name: str) -> list[Tick]:
    """Returns the periods of a case after replay."""
    case, ticks = CASES[name], list[Tick]()
    with ReplayDriver(described(case.robot), str(FOLDER / f"{name}.mcap")) as driver:
        run(driver, case.capability(), duration=case.duration, observe=ticks.append)
    return ticks


def perceived(ticks: Iterable[Tick]) -> dict[str, np.ndarray[Any, Any]]:
    """Returns the numeric values of all perceptions of a run, by name: one row per period, and one row per
    contact."""
    periods, contacts = [], []
    for tick in ticks:
        perception = tick.perception
        posture = np.concatenate([perception.posture[part] for part in sorted(perception.posture)])
        periods.append(
            [tick.now, perception.stamp, len(perception.contacts), len(perception.ended), *posture]
        )
        contacts += [
            [
                c.identity, len(c.taxels), c.stamp, c.onset, c.displacement, c.force, c.peak, c.area,
                c.u, c.theta, *c.p_L, *c.n_L, *c.p_T, *c.n_T, *c.f_T,
                c.taxels.sum(), c.taxel_forces @ c.taxels,
            ]
            for c in perception.contacts
        ]  # fmt: skip
    return {"periods": np.array(periods), "contacts": np.array(contacts)}


if __name__ == "__main__":
    again = sys.argv[1:2] == ["perceived"]
    names = sys.argv[2:] if again else sys.argv[1:]
    for one in CASES if names == ["all"] else names:
        if again:
            np.savez_compressed(FOLDER / f"{one}.npz", **perceived(replayed(one)))
        else:
            record(one)
        print(one, (FOLDER / f"{one}.mcap").stat().st_size)
