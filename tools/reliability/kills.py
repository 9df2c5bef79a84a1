"""Kills the name server, the control board and the robot while an arm moves over YARP. The arm must hold and
later continue."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from rich.progress import track
from row import Row

import tci
from helpers.wire_peers import free_port
from tci.gate.gate import GateState
from tci.wires.yarp.driver import YarpDriver

NAMES = """
import sys, threading
from yarpwire.name_server import NameServer
NameServer(sys.argv[1], int(sys.argv[2]))
print("ready", flush=True)
threading.Event().wait()
"""
ROBOT = """
import signal, sys
import tci
from tci.drivers.simulated import SimulatedDriver
from tci.wires.yarp.server import YarpServer
from tci.runtime.serve import serve

PART, AWAY = "LArm", 100
asked, told = [], []
signal.signal(signal.SIGUSR1, lambda *_: asked.append(AWAY))
driver = SimulatedDriver(tci.load_robot("nao"), paced=True)
server = YarpServer(driver, sys.argv[1])

def see(tick):
    if not told:
        told.append(print("ready", flush=True))
    if asked and asked[0] == AWAY:
        server.close_board(PART)
    if asked:
        asked[0] -= 1
        if asked[0] == 0:
            asked.clear()
            server.open_board(PART)

serve(server, observe=see)
"""
HELD = 0.1
"""Age [s] of joint data beyond which the gate must hold."""
JUMP = 0.02
"""Displacement [rad] between two readings, in addition to the displacement at the speed limit, that counts as
a jump."""
PATIENCE = 60.0
"""Longest time [s] until the robot works again."""
KINDS = ("name server", "board", "robot")


@dataclass
class Seen:
    """Observations of one run of the loop."""

    oldest: float = 0.0
    """Greatest age [s] of joint data that the gate accepted without a hold."""
    jumps: int = 0
    lost: list[str] = field(default_factory=list)
    """Kinds of killed processes after whose kill the arm did not continue."""


class Trial:
    """An arm that moves back and forth, and the processes that are killed during the motion."""

    def __init__(self) -> None:
        self.where = f"127.0.0.1:{free_port()}"
        self.seen = Seen()
        self._names = self._start(NAMES, *self.where.split(":"))
        self._robot = self._start(ROBOT, self.where)
        for process in (self._names, self._robot):
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
        robot = tci.load_robot("nao")
        self.driver = YarpDriver(robot, self.where, arm=True)
        self._arm = self.driver.native("LArm")
        servo = next(servo for servo in self._arm.servos if servo.name == "LElbowRoll")
        self._servo, self._fastest = servo.index, float(servo.limits.velocity or 0.0)
        self._targets, self._last = [-0.4, -1.2], (0.0, np.nan)
        self._ticks = self.driver.ticks()
        self._before = GateState.RUN

    @staticmethod
    def _start(program: str, *arguments: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-c", program, *arguments]
        return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def step(self) -> GateState:
        """Runs one period."""
        driver, now = self.driver, next(self._ticks)
        joints = driver.read().joints
        angle = float(joints.position[self._servo])
        passed = joints.stamp - self._last[0]
        # the first angle after a restart of the robot can't be compared with the last angle before
        if passed > 0.0:
            self.seen.jumps += abs(angle - self._last[1]) > self._fastest * passed + JUMP
            self._last = joints.stamp, angle
        if abs(angle - self._targets[0]) < 0.05:
            self._targets.reverse()
        order = self._arm.command({"LElbowRoll": self._targets[0]}, speed=0.5)
        sent = driver.write(driver.gate.step([order], joints, now))
        if sent.state is GateState.RUN:
            self.seen.oldest = max(self.seen.oldest, now - joints.stamp)
        self._before = sent.state
        return sent.state

    def until(self, condition: Callable[[], bool]) -> bool:
        """Steps until a condition is true. Returns False if this takes longer than PATIENCE."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            self.step()
            if condition():
                return True
        return False

    def goes(self) -> bool:
        """Returns True if the arm reaches both of its targets."""
        return all(self.until(lambda t=self._targets[0]: self._targets[0] != t) for _ in range(2))

    def kill(self, kind: str, chance: random.Random) -> None:
        """Kills one process, starts it again, and checks that the arm continues."""
        self.run_for(chance.uniform(0.0, 1.0))
        holds = True
        if kind == "board":
            self._robot.send_signal(signal.SIGUSR1)
            holds = self.until(lambda: self._before is GateState.HOLD)
        elif kind == "robot":
            self._robot.kill()
            self._robot.communicate()
            holds = self.until(lambda: self._before is GateState.HOLD)
            self._robot = self._start(ROBOT, self.where)
            self._last = 0.0, np.nan  # another robot, elsewhere
        else:
            self._names.kill()
            self._names.communicate()
            self.run_for(chance.uniform(0.0, 1.0))
            self._names = self._start(NAMES, *self.where.split(":"))
        if not (holds and self.until(lambda: self._before is GateState.RUN) and self.goes()):
            self.seen.lost.append(kind)

    def run_for(self, seconds: float) -> None:
        """Runs periods for some time [s]."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.step()

    def close(self) -> None:
        self.driver.close()
        for process in (self._robot, self._names):
            process.kill()
            process.communicate()


def yarp_kills(full: bool) -> Row:
    """Kills each process in turn, at random moments."""
    count, chance = (102 if full else 3), random.Random(6)
    with tempfile.TemporaryDirectory() as folder:
        os.environ["YARP_CONFIG_HOME"] = folder
        trial = Trial()
        try:
            for number in track(range(count), "kills over YARP"):
                trial.kill(KINDS[number % len(KINDS)], chance)
        finally:
            trial.close()
    seen = trial.seen
    return Row(
        "kills of the name server, a board or the robot, over YARP",
        count,
        100,
        "kills",
        f"oldest joint data without HOLD {seen.oldest * 1e3:.0f} ms; {seen.jumps} jumps of the joint; after "
        f"{count - len(seen.lost)} kills the motion continued {' '.join(seen.lost)}".strip(),
        "at most 100 ms, 0 jumps, the motion continues after every kill",
        seen.oldest <= HELD and not seen.jumps and not seen.lost,
    )


if __name__ == "__main__":
    sys.path.insert(0, "tests")
    print(yarp_kills(os.environ.get("FULL") == "1"))
