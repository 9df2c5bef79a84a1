"""Pokes every robot over every middleware, with the pokes of the demo and with pokes of head, torso, hands
and legs. The reflexes run in another process.

python tools/middleware/robots.py [--robot NAME]... [--via NAME]... [--short] [--patience SECONDS]

writes docs/tables/robots-and-wires.md. Table cells that an interrupted run measured at the same commit are
stored in OUT/robots-and-wires.json and used again.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parents[2]
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tools")]

from report import TABLES, commit, markdown, out, save
from rich.progress import Progress

import tci
from helpers.wire_peers import PEERS, wire
from tci.capabilities import lacks
from tci.lab.experiments.body_trials import answerable, body_trials_of
from tci.lab.experiments.experiment import trials_of
from tci.lab.experiments.poke import Stimulus
from tci.lab.experiments.trial_places import PER_ARM, pads, sleeves
from tci.robot.description import Robot

TABLE = TABLES / "robots-and-wires.md"
FILE = "robots-and-wires.json"
WIRES = tuple(name for name in PEERS if name not in ("sim", "unitree"))
"""Middleware between processes that can transport skin data. Unitree's topics transport only joint data, so
they are left out."""
REFLEXES = (tci.WithdrawalReflex(), tci.BodyWithdrawal())
ROBOTS = tuple(
    name
    for name in tci.robot_names()
    if (robot := tci.load_robot(name)).skin and not all(lacks(one, robot) for one in REFLEXES)
)
"""Robots with taxels to which a reflex answers. Left out are robots that sense touches only through their
joints, and those with switches only."""
TRIES = 3
"""Number of attempts for each poke. An attempt fails without a fault of TCI if another program keeps the
processor busy: the gate then holds the robot."""
NEVER = -1
"""Value that is stored instead of the number of the attempt if the reflex never responded to a poke."""
SEED = 3


@dataclass(frozen=True)
class Cell:
    """One table cell: the results of one robot over one middleware."""

    answered: int = 0
    """Number of pokes to which the reflex responded as it does within one process."""
    pokes: int = 0
    again: int = 0
    """Number of pokes to which the reflex responded only in a repeated attempt."""
    command_ms: float | None = None
    """Median time [ms] from the first contact to the first command."""
    violations: Sequence[str] = ()
    """Limits that were broken, one sentence each."""
    reason: str = ""
    """Reason why not all pokes were answered."""

    def __str__(self) -> str:
        if not self.pokes:
            return self.reason
        late = "" if self.command_ms is None else f", {self.command_ms:.0f} ms"
        broken = f", **limits broken: {len(self.violations)}**" if self.violations else ""
        why = f": {self.reason}" if self.reason else ""
        return f"{self.answered} of {self.pokes}{late}{broken}{why}"


def reflexes(*, short: bool) -> tuple[tci.WithdrawalReflex, tci.BodyWithdrawal]:
    """Returns the reflex of the arms and the reflex of the other parts. If `short`, the latter has only one
    field of each part."""
    arms, others = tci.WithdrawalReflex(), tci.BodyWithdrawal(stance="supported")
    if short:
        first = {field.kind: field for field in reversed(others.fields.field)}
        others = replace(others, fields=others.fields.model_copy(update={"field": tuple(first.values())}))
    return arms, others


def measured(robot: Robot, name: str, *, short: bool) -> Cell:
    """Measures one robot over one middleware and returns the cell."""
    try:
        robot.binding(name.removesuffix("4"))
    except tci.UnknownNameError:
        return Cell(reason=f"{name} needs a `binding` in the description")
    arms, others = reflexes(short=short)
    body = tci.GenericBody(robot)
    beyond = sum(len(answerable(body, field)) for field in others.fields.field)
    count = 1 if short else PER_ARM
    total = count * len(sleeves(robot) or pads(robot)) + beyond
    seen: dict[tuple[str, str], int] = {}
    times: list[float] = []
    broken: list[str] = []
    trouble = ""
    with wire(name) as via:
        for tried in range(TRIES):
            try:
                trials = [trials_of(robot, arms, stimulus=Stimulus(), seed=SEED, via=via, count=count)]
                if beyond:
                    trials.append(body_trials_of(robot, others, seed=SEED, via=via))
                for trial in chain.from_iterable(trials):
                    site = (trial.side, trial.site)
                    broken += trial.violations
                    if seen.get(site, NEVER) == NEVER:
                        seen[site] = tried if trial.responded else NEVER
                        times += [] if trial.trigger_ms is None else [trial.trigger_ms]
            # e.g. no processor time for the other process
            except tci.TciError as error:
                trouble = str(error)
                continue
            if len(seen) == total and NEVER not in seen.values():
                break
    answered = [tried for tried in seen.values() if tried != NEVER]
    late = median(times) if times else None
    reason = "" if len(answered) == total else trouble or "no answer"
    return Cell(len(answered), total, sum(tried > 0 for tried in answered), late, broken, reason)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robot", action="append", choices=ROBOTS)
    parser.add_argument("--via", action="append", choices=WIRES)
    parser.add_argument("--short", action="store_true", help="one poke of each part")
    parser.add_argument("--patience", type=float, help="silence [s] until a robot holds, on a busy machine")
    asked = parser.parse_args(arguments)
    file = out() / FILE
    before = json.loads(file.read_text()) if file.is_file() else {}
    found = before["cells"] if before.get("commit") == commit() else {}
    load = os.getloadavg()[0]
    with Progress() as progress:
        pairs = [(robot, via) for via in asked.via or WIRES for robot in asked.robot or ROBOTS]
        task = progress.add_task("", total=len(pairs))
        for robot, via in pairs:
            progress.update(task, advance=1, description=f"{robot} via {via}")
            if f"{robot} {via}" not in found:
                words = tci.load_robot(robot)
                words = words.with_stale_after(asked.patience) if asked.patience else words
                cell = measured(words, via, short=asked.short)
                found[f"{robot} {via}"] = asdict(cell)
                save(FILE, {"commit": commit(), "cells": found})
                progress.console.print(f"{robot} via {via}: {cell}", highlight=False)
    cells = {key: Cell(**values) for key, values in found.items()}
    vias = [via for via in WIRES if any(key.endswith(f" {via}") for key in cells)]
    rows = [
        (f"`{robot}`", *(str(cells.get(f"{robot} {via}", "not run")) for via in vias))
        for robot in ROBOTS
        if any(f"{robot} {via}" in cells for via in vias)
    ]
    again = sum(cell.again for cell in cells.values())
    what = (
        "Each part is poked once."
        if asked.short
        else "The pokes are those of `tci demo`, and pokes of the other parts."
    )
    patience = f" Robots held after a silence of {asked.patience:g} s." if asked.patience else ""
    about = (
        f"{what} A cell contains the number of pokes that the reflexes answered, and the "
        f"median time from the first contact to the first command. Measured at {commit()} on "
        f"{os.cpu_count()} cores at a load of {load:.1f}; {again} pokes were answered only when they were "
        f"repeated.{patience}"
    )
    TABLE.write_text(f"{markdown(('robot', *(f'`{via}`' for via in vias)), rows)}\n{about}\n")


if __name__ == "__main__":
    main()
