"""Tries `tci new-robot --hand-skin` and the light grasp on hands that nobody prepared, and writes
docs/tables/hands-tried.md.

    python tools/try_hands.py [--robot NAME FILE]... [--hand NAME LEFT RIGHT]... [--table]

--robot tries a robot with its own hands. --hand tries the MJCFs of a left and a right hand on the wrists of
the G1 of example-robot-data, which has none. "Right" is the verdict of `judge_proposal`. The forces are
those that the simulated skin of the finger tips measures while the hand holds a ball that fits the hand.
Results stay in OUT/hands-tried; --table makes the table of all of them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from judge_proposal import complaints
from report import TABLES, commit, markdown, out
from try_robots import NO_MESHES, _tci, exported, of_package

from tci.lab.experiments.grasp import try_grasp
from tci.messages.frames import Array
from tci.robot.xml import read_robot

TABLE = TABLES / "hands-tried.md"
HEAD = ("hand", "on", "fingers", "proposed", "ball [mm]", "force of each finger [N]", "highest force [N]",
        "opens on a pull")  # fmt: skip
BASE, WRIST, OWN_HAND = "g1_29dof_rev_1_0", "{}_wrist_yaw_link", "rubber_hand"
"""Model without hands, the link of its wrist, and a word in the names of the hand's own shapes."""
REACH = np.array([0.05, 0.0, 0.0])
"""Place [m] of a hand's root in the link of the wrist, whose x axis points to the hand. Assumed:
the hand's own shapes then begin where those of the removed rubber hand began."""


@dataclass
class Tried:
    """Results of one pair of hands."""

    name: str
    robot: str
    refused: str = ""
    wrong: list[str] = field(default_factory=list)
    """Complaints of the judge."""
    hands: list[dict[str, Any]] = field(default_factory=list)
    """Result of the grasp of each hand, or the reason for which there is none."""
    commit: str = ""

    def row(self) -> tuple[str, ...]:
        """Returns the row of the table."""
        if self.refused:
            return (self.name, self.robot, "", f"refused: {self.refused}", "", "", "", "")
        proposed = "right" if not self.wrong else f"**wrong**: {'; '.join(self.wrong)}"
        bad = [str(hand["failed"]) for hand in self.hands if "failed" in hand]
        done = [hand for hand in self.hands if "failed" not in hand]
        if bad or not done:
            return (self.name, self.robot, "", proposed, "; ".join(bad) or "no fingers", "", "", "")
        forces = [force for hand in done for force in hand["forces"].values()]
        held = f"{min(forces):.2f} to {max(forces):.2f}" if forces else "none"
        return (
            self.name, self.robot, str(len(done[0]["forces"])), proposed,
            " and ".join(dict.fromkeys(f"{2000.0 * hand['radius']:.0f}" for hand in done)), held,
            f"{max(hand['peak'] for hand in done):.1f}",
            "yes" if all(hand["opened"] for hand in done) else "**no**",
        )  # fmt: skip


def with_hands(arms: Path, hands: Mapping[str, Path], target: Path) -> Path:
    """Writes the MJCF of a robot whose wrists carry a left and a right hand."""
    spec = mujoco.MjSpec.from_file(str(arms))
    for side, file in hands.items():
        hand = mujoco.MjSpec.from_file(str(file))
        folder = file.parent / (hand.meshdir or ".")
        for mesh in hand.meshes:
            mesh.file = str((folder / mesh.file).resolve()) if mesh.file else ""
        hand.meshdir = ""
        wrist = spec.body(WRIST.format(side))
        for geom in wrist.geoms:
            if OWN_HAND in geom.meshname:
                spec.delete(geom)
        root = hand.worldbody.first_body()
        root.pos, root.quat = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, _mounted(hand).ravel())
        wrist.add_frame(pos=REACH, quat=quat).attach_body(root, f"{side}_hand_", "")
    spec.compile()
    target.write_text(spec.to_xml())
    return target


def _mounted(hand: mujoco.MjSpec) -> Array:
    """Returns the rotation (3, 3) of a hand at a wrist: its fingers point ahead, and its thumb is up.

    A hand's fingers point away from its root, and the thumb is beside the index finger.
    """
    model = hand.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tips = {name: data.xpos[model.body(name).id] for name in _leaves(model)}
    others = np.array([place for name, place in tips.items() if "th" not in name.lower()])
    ahead = _unit(others.mean(axis=0))
    rows = others - others.mean(axis=0)
    across = np.linalg.svd(rows)[2][0]
    index = next(place for name, place in tips.items() if "index" in name.lower() or "ff" in name.lower())
    across *= float(np.sign(across @ (index - others.mean(axis=0))))
    up = _unit(across - ahead * float(ahead @ across))
    R_HW: Array = np.array([ahead, np.cross(up, ahead), up])
    return R_HW


def _leaves(model: mujoco.MjModel) -> list[str]:
    """Returns the outermost links."""
    parents = set(model.body_parentid[1:].tolist())
    return [model.body(body).name for body in range(1, model.nbody) if body not in parents]


def _unit(vector: Array) -> Array:
    along: Array = vector / float(np.linalg.norm(vector))
    return along


def attempt(name: str, robot: str, model: Path, folder: Path, *, package: str | None = None) -> Tried:
    """Proposes a robot with skin on its hands, and lets each hand grasp a ball."""
    tried = Tried(name, robot, commit=commit())
    target = folder / "robot.xml" if package else model.parent / f"{model.stem}.robot.xml"
    new = ["new-robot", str(model), "--name", "tried", "--out", str(target), "--force", "--hand-skin"]
    new += ["--package", package] if package else []
    told, error = _tci(new, 600.0)
    if told is None and NO_MESHES in error:
        told, error = _tci([*new, NO_MESHES], 600.0)
    if told is None:
        tried.refused = " ".join(error.split())
        return tried
    described = read_robot(target)
    tried.wrong = complaints(described, [*told["found"], *told["remarks"]])
    for part in described.parts:
        if part.kind == "fingers":
            try:
                tried.hands.append({"part": part.name, **asdict(try_grasp(described, part.name))})
            except Exception as problem:
                tried.hands.append({"part": part.name, "failed": f"{type(problem).__name__}: {problem}"})
    return tried


def write_table(results: Sequence[Tried]) -> None:
    """Writes the table of all results."""
    commits = ", ".join(sorted({one.commit for one in results}))
    rows = [one.row() for one in sorted(results, key=lambda one: one.name.lower())]
    TABLE.write_text(
        f"{markdown(HEAD, rows)}\nMade by `python tools/try_hands.py` at {commits} with MuJoCo "
        f"{mujoco.__version__}.\n"
    )


def main() -> None:
    """Tries the hands, or makes the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robot", action="append", nargs=2, default=[], metavar=("NAME", "FILE"))
    parser.add_argument("--hand", action="append", nargs=3, default=[], metavar=("NAME", "LEFT", "RIGHT"))
    parser.add_argument("--table", action="store_true", help="write the table of all results")
    options = parser.parse_args()
    results = out() / "hands-tried"
    results.mkdir(exist_ok=True)
    jobs = [(name, Path(file).stem, Path(file).resolve()) for name, file in options.robot]
    for name, left, right in options.hand:
        base = next(one for one in of_package("example-robot-data") if one.name == BASE)
        arms = exported(base, results / BASE).file
        hands = {"left": Path(left).resolve(), "right": Path(right).resolve()}
        jobs.append((name, BASE, with_hands(arms, hands, arms.with_name(f"{name}.xml"))))
    for name, robot, file in jobs:
        tried = attempt(name, robot, file, results)
        (results / f"{name}.json").write_text(json.dumps(asdict(tried), indent=2) + "\n")
        print(" | ".join(tried.row()), flush=True)
    if options.table:
        write_table([Tried(**json.loads(file.read_text())) for file in sorted(results.glob("*.json"))])


if __name__ == "__main__":
    main()
