"""Runs `tci new-robot`, `tci check --simulate` and `tci demo` on published robot models that were not
prepared for TCI, and writes docs/tables/robots-tried.md.

    python tools/try_robots.py [FILE]... [--package NAME]... [--export STEM]... [--limit SECONDS]
        [--part I/N] [--table]

If new-robot refuses a model because meshes are missing, the program tries the model again without meshes.
--export STEM also tries the package's URDFs with this name after MuJoCo has exported them as MJCF. The column
"right" is the judgement of `judge_proposal`, which shares no code with new-robot. The results are stored in
OUT/robots-tried; --table writes the table of all stored results. --part 1/2 and --part 2/2 divide the models
between two processes.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

import mujoco
from judge_proposal import complaints, two_arms
from lxml import etree
from report import TABLES, commit, markdown, out

from tci.errors import TciError
from tci.robot.description import Model, Robot
from tci.robot.model_file import load_spec
from tci.robot.xml import read_robot

TABLE = TABLES / "robots-tried.md"
HEAD = ("robot", "model", "arms", "hands", "head", "torso", "legs", "proposed", "edits",
        "check --simulate", "demo: pokes answered")  # fmt: skip
TCI = (sys.executable, "-c", "from tci.cli.main import main; main()")
NO_MESHES = "--without-meshes"


@dataclass(frozen=True)
class Candidate:
    """A robot model to try."""

    name: str
    file: Path
    package: str | None = None


@dataclass
class Tried:
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
        demo = f"{self.answered} of {self.pokes}"
        if self.failed:
            check, demo = (self.failed, "") if self.failed.startswith("check") else (check, self.failed)
        return (*start, *self.joints, proposed, " ".join(self.edits) or "none", check, demo)


def _short(faults: Sequence[str]) -> str:
    return "; ".join(dict.fromkeys(fault.split(";")[0] for fault in faults[:3])) if faults else ""


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


def attempt(candidate: Candidate, folder: Path, limit: float) -> Tried:
    """Runs the three commands on one model."""
    begin = time.perf_counter()
    path = candidate.file
    kind = "MJCF" if path.suffix.lower() == ".xml" else "URDF"
    tried = Tried(candidate.name, kind, candidate.package or path.name, commit=commit())
    folder.mkdir(parents=True, exist_ok=True)
    # A description finds its model only in its own folder or in an installed package.
    target = folder / "robot.xml" if candidate.package else path.parent / f"{candidate.name}.robot.xml"
    new = ["new-robot", str(path), "--name", candidate.name, "--out", str(target), "--force"]
    new += ["--package", candidate.package] if candidate.package else []
    told, error = _tci(new, limit)
    if told is None and NO_MESHES in error:
        tried.edits = [NO_MESHES]
        told, error = _tci([*new, NO_MESHES], limit)
    if told is None:
        tried.refused = " ".join(error.split())
        tried.two_arms = two_arms(_names(path))
        return tried
    robot = read_robot(target)
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
    tried.seconds = round(time.perf_counter() - begin, 1)
    if candidate.package is None:
        target.unlink()
    return tried


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


def _names(path: Path) -> list[str]:
    """Returns the names of a model's rotational joints."""
    root = etree.parse(str(path)).getroot()
    still = ("fixed", "floating", "free", "prismatic", "slide", "planar")
    return [str(one.get("name")) for one in root.iter("joint") if one.get("type", "hinge") not in still]


def _mapped(robot: Robot, kind: str) -> str:
    """Returns the number of mapped joints of each part of a kind that the robot has."""
    counts = [sum(one.servo is not None for one in part.servos) for part in robot.parts if part.kind == kind]
    return " + ".join(str(count) for count in counts) or "0"


def write_table(results: Sequence[Tried]) -> None:
    """Writes the table of all stored results."""
    humanoid = [one for one in results if one.two_arms]
    proposed = [one for one in humanoid if not one.refused]
    right = sum(not one.wrong for one in proposed) + sum("; valid" in one.refused for one in humanoid)
    proved = sum(one.proved for one in proposed)
    answered, pokes = sum(one.answered for one in proposed), sum(one.pokes for one in proposed)
    others = sorted(one.name for one in results if not one.two_arms)
    commits = ", ".join(sorted({one.commit for one in results}))
    TABLE.write_text(
        f"{len(humanoid)} models have two arms. For {right} of them the proposal is right, or the model is "
        f"refused with an error that explains what to change. {proved} of {len(proposed)} proposed "
        f"descriptions pass `check --simulate`. In the demo the reflexes answer {answered} of {pokes} "
        "pokes.\n\n"
        + markdown(HEAD, [one.row() for one in sorted(humanoid, key=lambda one: one.name.lower())])
        + (
            f"\nThese models are refused, because they do not have two arms: {', '.join(others)}.\n"
            if others
            else ""
        )
        + f"\nMade by `python tools/try_robots.py` at {commits} with MuJoCo {mujoco.__version__}.\n"
    )


def main() -> None:
    """Tries the models, or writes the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, help="URDF or MJCF files")
    parser.add_argument("--package", action="append", default=[], help="installed package: all its models")
    parser.add_argument("--only", action="append", default=[], help="only models of this name")
    parser.add_argument("--export", action="append", default=[], help="name of a URDF to export as MJCF")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds for each command")
    parser.add_argument("--part", default="1/1", help="I/N: every Nth model, from the Ith on")
    parser.add_argument("--table", action="store_true", help="write the table of all results")
    options = parser.parse_args()
    results = out() / "robots-tried"
    packaged = [one for package in options.package for one in of_package(package)]
    jobs = [(Candidate(file.stem, file.resolve()), False) for file in options.files]
    jobs += [(one, True) for one in packaged if one.name in options.export]
    jobs += [(one, False) for one in packaged if not options.only or one.name in options.only]
    part, parts = (int(word) for word in options.part.split("/"))
    for given, as_mjcf in jobs[part - 1 :: parts]:
        candidate = exported(given, results / given.name) if as_mjcf else given
        tried = attempt(candidate, results / candidate.name, options.limit)
        (results / f"{candidate.name}.json").write_text(json.dumps(asdict(tried), indent=2) + "\n")
        print(" | ".join(tried.row()), f"({tried.seconds:g} s)", flush=True)
    if options.table:
        write_table([Tried(**json.loads(file.read_text())) for file in sorted(results.glob("*.json"))])


if __name__ == "__main__":
    main()
