"""Tries `tci` on published robots and hands that nobody prepared for it, and writes
docs/tables/robots-tried.md and docs/tables/hands-tried.md.

    python tools/tried.py robots [FILE]... [--package NAME]... [--export STEM]...
        [--limit SECONDS] [--part I/N]
    python tools/tried.py hands [--robot NAME FILE]... [--hand NAME LEFT RIGHT]...

`robots` runs new-robot, check --simulate and demo. --export STEM also tries the package's URDFs with this
name after MuJoCo has exported them as MJCF; --part 1/2 and --part 2/2 divide the models between two
processes. `hands` runs new-robot --hand-skin and the light grasp: --robot tries a robot with its own hands,
--hand the MJCFs of two hands on the wrists of the G1 of example-robot-data, which has none. If new-robot
refuses a model because meshes are missing, it is tried again without. "Right" is the verdict of
`judge_proposal`, which shares no code with new-robot. Results stay in OUT/robots-tried and OUT/hands-tried;
--table makes the table of all of them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from judge_proposal import complaints, two_arms
from lxml import etree
from report import TABLES, commit, markdown, out

from tci.errors import TciError
from tci.lab.experiments.grasp import try_grasp
from tci.messages.frames import Array
from tci.robot.description import Model, Robot
from tci.robot.model_file import load_spec
from tci.robot.xml import read_robot

TCI = (sys.executable, "-c", "from tci.cli.main import main; main()")
NO_MESHES = "--without-meshes"

ROBOTS = ("robot", "model", "arms", "hands", "head", "torso", "legs", "proposed", "edits",
        "check --simulate", "demo: pokes answered")  # fmt: skip
HANDS = ("hand", "on", "fingers", "proposed", "ball [mm]", "force of each finger [N]", "highest force [N]",
        "opens on a pull")  # fmt: skip
BASE, WRIST, OWN_HAND = "g1_29dof_rev_1_0", "{}_wrist_yaw_link", "rubber_hand"
"""Model without hands, the link of its wrist, and a word in the names of the hand's own shapes."""
REACH = np.array([0.05, 0.0, 0.0])
"""Place [m] of a hand's root in the link of the wrist, whose x axis points to the hand. Assumed:
the hand's own shapes then begin where those of the removed rubber hand began."""


def _tci(arguments: Sequence[str], limit: float) -> tuple[Any, str]:
    """Returns a command's output as JSON, or None with the last part of its error messages."""
    command = [*TCI, *arguments, "--json"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
    except subprocess.TimeoutExpired:
        return None, f"took longer than {limit:g} s"
    try:
        told = json.loads(done.stdout)
        return (None, json.dumps(told)) if "error" in told else (told, "")
    except json.JSONDecodeError:
        words = [line for line in done.stderr.splitlines() if line.strip() and "WARNING" not in line]
        return None, " ".join(words)[-600:] or f"exit status {done.returncode}"


def _proposed(file: Path, name: str, target: Path, limit: float, *more: str) -> tuple[Any, str, bool]:
    """Runs new-robot, again without meshes if they are missing. Returns its output, or None with the reason,
    and True if it ran without meshes."""
    words = ["new-robot", str(file), "--name", name, "--out", str(target), "--force", *more]
    told, error = _tci(words, limit)
    if told is not None or NO_MESHES not in error:
        return told, error, False
    return *_tci([*words, NO_MESHES], limit), True


@dataclass(frozen=True)
class Candidate:
    """A robot model to try."""

    name: str
    file: Path
    package: str | None = None


@dataclass
class TriedRobot:
    """Results of one robot."""

    name: str
    model: str
    source: str
    joints: list[str] = field(default_factory=list)
    """Number of mapped joints in arms, hands, head, torso and legs."""
    edits: list[str] = field(default_factory=list)
    """Options of new-robot that were used in addition to the file."""
    refused: str = ""
    wrong: list[str] = field(default_factory=list)
    """Faults that `judge_proposal` found."""
    doubts: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    """Faults that `tci check --simulate` found."""
    proved: bool = False
    answered: int = 0
    pokes: int = 0
    unanswered: list[str] = field(default_factory=list)
    """Why no reflex answers the patches, by part, of a robot on which none is answered."""
    failed: str = ""
    """Command that failed or exceeded the time limit."""
    seconds: float = 0.0
    commit: str = ""
    two_arms: bool = True

    def row(self) -> tuple[str, ...]:
        """Returns the row of the table."""
        start = self.name, self.model
        if self.refused:
            faults = json.loads(self.refused).get("faults", ()) if self.refused.startswith("{") else ()
            words = "; ".join(fault["message"] for fault in faults) or self.refused
            return (*start, *[""] * 5, f"refused: {words}", *[""] * 3)
        proposed = "right" if not self.wrong else f"**wrong**: {'; '.join(self.wrong)}"
        check = "proved" if self.proved else f"{len(self.faults)} faults: {_short(self.faults)}"
        demo = ": ".join(filter(None, [f"{self.answered} of {self.pokes}", "; ".join(self.unanswered)]))
        if self.failed:
            check, demo = (self.failed, "") if self.failed.startswith("check") else (check, self.failed)
        return (*start, *self.joints, proposed, " ".join(self.edits) or "none", check, demo)


def _short(faults: Sequence[str]) -> str:
    return "; ".join(dict.fromkeys(fault.split(";")[0] for fault in faults[:3])) if faults else ""


def _unanswered(patches: Sequence[Mapping[str, Any]]) -> list[str]:
    """The parts of the patches that no reflex answers, with the reason."""
    parts: dict[str, dict[str, None]] = {}
    for one in patches:
        if not one["answered"]:
            why = one["reason"].partition(" does not move: ")[2].partition(";")[0]
            parts.setdefault(why or "no reflex has a field there", {})[one["part"]] = None
    return [f"{', '.join(own)}: {why}" for why, own in parts.items()]


def of_package(package: str) -> Iterator[Candidate]:
    """Yields all URDFs and MJCFs of an installed package."""
    for entry in distribution(package).files or ():
        if entry.suffix.lower() in (".urdf", ".xml") and "package.xml" not in entry.name:
            yield Candidate(entry.stem, Path(str(entry.locate())).resolve(), package)


def exported(candidate: Candidate, folder: Path) -> Candidate:
    """Writes MuJoCo's export of a URDF as MJCF. Raises TciError if MuJoCo can't read the meshes."""
    spec = load_spec(Model(format="urdf", path=str(candidate.file), torso_link="?"))
    missing = [mesh.file for mesh in spec.meshes if mesh.file and not Path(mesh.file).is_file()]
    if missing:
        raise TciError(f"{candidate.name}: MuJoCo can't read {len(missing)} of its meshes")
    spec.compile()
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{candidate.name}.xml"
    path.write_text(spec.to_xml())
    return Candidate(f"{candidate.name}-mjcf", path)


def try_robot(candidate: Candidate, folder: Path, limit: float) -> TriedRobot:
    """Runs the three commands on one model."""
    begin = time.perf_counter()
    path = candidate.file
    kind = "MJCF" if path.suffix.lower() == ".xml" else "URDF"
    tried = TriedRobot(candidate.name, kind, candidate.package or path.name, commit=commit())
    folder.mkdir(parents=True, exist_ok=True)
    # A description finds its model only in its own folder or in an installed package.
    target = folder / "robot.xml" if candidate.package else path.parent / f"{candidate.name}.robot.xml"
    package = ["--package", candidate.package] if candidate.package else []
    told, error, bare = _proposed(path, candidate.name, target, limit, *package)
    tried.edits = [NO_MESHES] if bare else []
    if told is None:
        tried.refused = " ".join(error.split())
        tried.two_arms = two_arms(_names(path))
        return tried
    robot = read_robot(target)
    tried.two_arms = sum(part.kind == "arm" for part in robot.parts) == 2
    if not tried.two_arms:  # `arms.py` tries what stands alone
        return tried
    tried.joints = [_mapped(robot, kind) for kind in ("arm", "hand", "head", "torso", "leg")]
    tried.wrong = complaints(robot, [*told["found"], *told["remarks"]])
    checked, error = _tci(["check", "--simulate", str(target)], limit)
    if checked is None:
        tried.failed = f"check: {error}"
    else:
        tried.doubts, tried.faults = checked["doubts"], checked["simulated"]["faults"]
        tried.proved = not tried.faults
    shown, error = _tci(["demo", str(target), "--headless", "--out", str(folder)], limit)
    if shown is None:
        tried.failed = tried.failed or f"demo: {error}"
    else:
        tried.answered = sum(trial["responded"] for trial in shown["trials"])
        tried.pokes = len(shown["trials"])
        if checked is not None and not tried.answered:
            tried.unanswered = _unanswered(checked["simulated"]["patches"])
    tried.seconds = round(time.perf_counter() - begin, 1)
    if candidate.package is None:
        target.unlink()
    return tried


def _names(path: Path) -> list[str]:
    """Returns the names of a model's rotational joints."""
    root = etree.parse(str(path)).getroot()
    still = ("fixed", "floating", "free", "prismatic", "slide", "planar")
    return [str(one.get("name")) for one in root.iter("joint") if one.get("type", "hinge") not in still]


def _mapped(robot: Robot, kind: str) -> str:
    """Returns the number of mapped joints of each part of a kind that the robot has."""
    counts = [sum(one.servo is not None for one in part.servos) for part in robot.parts if part.kind == kind]
    return " + ".join(str(count) for count in counts) or "0"


def robots_table(results: Sequence[TriedRobot]) -> None:
    """Writes the table of all stored results."""
    humanoid = [one for one in results if one.two_arms]
    proposed = [one for one in humanoid if not one.refused]
    right = sum(not one.wrong for one in proposed) + sum("; valid" in one.refused for one in humanoid)
    proved = sum(one.proved for one in proposed)
    answered, pokes = sum(one.answered for one in proposed), sum(one.pokes for one in proposed)
    others = sorted(one.name for one in results if not one.two_arms)
    commits = ", ".join(sorted({one.commit for one in results}))
    (TABLES / "robots-tried.md").write_text(
        f"{len(humanoid)} models have two arms. For {right} of them the proposal is right, or the model is "
        f"refused with an error that explains what to change. {proved} of {len(proposed)} proposed "
        f"descriptions pass `check --simulate`. In the demo the reflexes answer {answered} of {pokes} "
        "pokes.\n\n"
        + markdown(ROBOTS, [one.row() for one in sorted(humanoid, key=lambda one: one.name.lower())])
        + (
            "\nThese models do not have two arms (`tools/arms.py` tries arms and hands that stand alone): "
            f"{', '.join(others)}.\n"
            if others
            else ""
        )
        + f"\nMade by `python tools/tried.py robots` at {commits} with MuJoCo {mujoco.__version__}.\n"
    )


@dataclass
class TriedHands:
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


def try_hands(name: str, robot: str, model: Path) -> TriedHands:
    """Proposes a robot with skin on its hands, and lets each hand grasp a ball."""
    tried = TriedHands(name, robot, commit=commit())
    target = model.parent / f"{model.stem}.robot.xml"
    told, error, _ = _proposed(model, "tried", target, 600.0, "--hand-skin")
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


def hands_table(results: Sequence[TriedHands]) -> None:
    """Writes the table of all results."""
    commits = ", ".join(sorted({one.commit for one in results}))
    rows = [one.row() for one in sorted(results, key=lambda one: one.name.lower())]
    (TABLES / "hands-tried.md").write_text(
        f"{markdown(HANDS, rows)}\nMade by `python tools/tried.py hands` at {commits} with MuJoCo "
        f"{mujoco.__version__}.\n"
    )


def robots(options: argparse.Namespace, folder: Path) -> Iterator[TriedRobot]:
    packaged = [one for package in options.package for one in of_package(package)]
    jobs = [(Candidate(file.stem, file.resolve()), False) for file in options.files]
    jobs += [(one, True) for one in packaged if one.name in options.export]
    jobs += [(one, False) for one in packaged if not options.only or one.name in options.only]
    part, parts = (int(word) for word in options.part.split("/"))
    for given, as_mjcf in jobs[part - 1 :: parts]:
        candidate = exported(given, folder / given.name) if as_mjcf else given
        yield try_robot(candidate, folder / candidate.name, options.limit)


def hands(options: argparse.Namespace, folder: Path) -> Iterator[TriedHands]:
    for name, file in options.robot:
        yield try_hands(name, Path(file).stem, Path(file).resolve())
    for name, left, right in options.hand:
        base = next(one for one in of_package("example-robot-data") if one.name == BASE)
        arms = exported(base, folder / BASE).file
        both = {"left": Path(left).resolve(), "right": Path(right).resolve()}
        yield try_hands(name, BASE, with_hands(arms, both, arms.with_name(f"{name}.xml")))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    kinds = parser.add_subparsers(dest="kind", required=True)
    parse = kinds.add_parser("robots")
    parse.add_argument("files", nargs="*", type=Path, help="URDF or MJCF files")
    parse.add_argument("--package", action="append", default=[], help="installed package: all its models")
    parse.add_argument("--only", action="append", default=[], help="only models of this name")
    parse.add_argument("--export", action="append", default=[], help="name of a URDF to export as MJCF")
    parse.add_argument("--limit", type=float, default=600.0, help="seconds for each command")
    parse.add_argument("--part", default="1/1", help="I/N: every Nth model, from the Ith on")
    parse.set_defaults(run=robots, result=TriedRobot, write=robots_table)
    parse = kinds.add_parser("hands")
    parse.add_argument("--robot", action="append", nargs=2, default=[], metavar=("NAME", "FILE"))
    parse.add_argument("--hand", action="append", nargs=3, default=[], metavar=("NAME", "LEFT", "RIGHT"))
    parse.set_defaults(run=hands, result=TriedHands, write=hands_table)
    for parse in kinds.choices.values():
        parse.add_argument("--table", action="store_true", help="write the table of all results")
    options = parser.parse_args()
    results = out() / f"{options.kind}-tried"
    results.mkdir(exist_ok=True)
    for tried in options.run(options, results):
        (results / f"{tried.name}.json").write_text(json.dumps(asdict(tried), indent=2) + "\n")
        print(" | ".join(tried.row()), flush=True)
    if options.table:
        found = [options.result(**json.loads(file.read_text())) for file in sorted(results.glob("*.json"))]
        options.write(found)


if __name__ == "__main__":
    main()
