"""Judge of tools on the skin that is there: each one on every packaged robot, and on one with a single patch.

`python -m helpers.every_tool [ROBOT...]` in `tests/` prints one row for each robot and tool: its exit status,
and which parts without skin it does not name. The status is 1 if any tool fails or names too little.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import tci
from helpers.one_patch import write_one_patch
from tci.body.touchable import without_skin
from tci.robot.catalogue import robot_names

ONE_PATCH = "one-patch"
PROGRAM = "import sys; from tci.cli.main import main; sys.argv[0] = 'tci'; main()"
EPISODE = """import sys; from tci.learn import TouchEnv; import numpy as np
env = TouchEnv(sys.argv[1]); env.reset(seed=0)
for _ in range(20): env.step(np.zeros(env.action_space.shape, np.float32))
env.close(); print(*env.without_skin, sep="; ")"""
"""An episode that begins with a touch, and what the environment says of parts without skin."""
Tool = Callable[[str, Path], tuple[str, ...]]


def _touch(robot: str, out: Path) -> tuple[str, ...]:
    listed = json.loads(_said(("touches", robot, "--json"))[1])
    place = [*listed["places"], *listed["patches"]][0]
    return "run", "withdrawal", robot, "--touch", f"press '{place}' 0.5s", "--duration", "1"


TOOLS: dict[str, Tool] = {
    "run --poke": lambda robot, out: ("run", "withdrawal", robot, "--poke", "--duration", "0.5"),
    "run --touch": _touch,
    "run --film": lambda robot, out: (
        "run", "withdrawal", robot, "--poke", "--duration", "0.4", "--film", str(out / "film.gif"),
    ),
    "demo": lambda robot, out: ("demo", robot, "--headless", "--out", str(out)),
    "check --simulate": lambda robot, out: ("check", robot, "--simulate"),
    "environment": lambda robot, out: (robot,),
}  # fmt: skip


def judged(robot: str, out: Path) -> Iterator[tuple[str, int, list[str], str]]:
    """For each tool its status, the parts without skin that it does not name, and what it said."""
    bare = without_skin(tci.load_robot(robot))
    for name, words in TOOLS.items():
        status, said = _said(words(robot, out), EPISODE if name == "environment" else PROGRAM)
        yield name, status, [part for part in bare if part not in said], said


def _said(words: tuple[str, ...], program: str = PROGRAM) -> tuple[int, str]:
    command = [sys.executable, "-c", program, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    whole = done.stdout if "--json" in words else done.stdout + done.stderr
    return done.returncode, whole if "--json" in words else " ".join(whole.split())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robots", nargs="*", default=(*robot_names(), ONE_PATCH))
    given, faults = parser.parse_args(), 0
    with TemporaryDirectory() as folder:
        patch = str(write_one_patch(Path(folder) / ONE_PATCH))
        for robot in given.robots:
            out = Path(folder) / f"out-{robot}"
            out.mkdir()
            for name, status, unnamed, said in judged(patch if robot == ONE_PATCH else robot, out):
                wrong = bool(status or unnamed)
                told = f"does not name {', '.join(unnamed)}" if unnamed else "names all parts without skin"
                said = f": {said}" if wrong else ""
                print(f"{robot:16} {name:17} status {status}, {told}{said}", flush=True)
                faults += wrong
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
