"""The first touch in a process causes no import and no compilation in the loop."""

from __future__ import annotations

import json
import subprocess
import sys

SCRIPT = """
import json, sys
from numba.core.event import install_recorder
import tci
from tci.drivers.simulated import SimulatedDriver
from tci.runtime.loop import run
from tci.simulation.world import World

robot = tci.load_robot("nao")
world = World(robot)
modules, answered = [], []

def observe(tick):
    modules.append(set(sys.modules))
    answered.extend(command.part for command in tick.commands)

with SimulatedDriver(robot, world=world) as driver, install_recorder("numba:compile") as compiled:
    world.finger.poke("left_forearm", 150, speed=0.25, depth=0.01, gap=0.02)
    run(driver, tci.WithdrawalReflex(), duration=0.6, observe=observe)
late = sorted(set.union(*modules) - modules[0])
print(json.dumps({"answered": answered, "imported": late, "compiled": len(compiled.buffer)}))
"""


def test_nothing_is_imported_or_compiled_during_the_first_answered_touch() -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True, timeout=120
    )
    found = json.loads(done.stdout.splitlines()[-1])
    assert "left_arm" in found["answered"]
    assert found["imported"] == []
    assert found["compiled"] == 0
