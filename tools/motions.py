"""Tries `tci gesture convert` on the public motion capture of `motions.toml`, and writes
docs/tables/motions-tried.md.

    python tools/motions.py DIR [NAME]...

DIR/OWNER+NAME is a checkout of each repository of the list. The judge reads the files itself and shares no
code with TCI: in every frame it places shoulder, elbow and wrist, and compares the bend of the elbow, and how
far the upper arm is raised from the line down the trunk. The bend is the same in all frames of reference. The
second tells gross errors only, since what is down in TCI is down in the rest pose and follows the chest.
Results stay in OUT/motions-tried, and the table has all of them; with NAMEs only these motions are tried.
"""

from __future__ import annotations

import argparse
import csv
import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from report import ROOT, TABLES, commit, markdown, out

Array = NDArray[np.float64]
TCI = (sys.executable, "-c", "from tci.cli.main import main; main()")
HEAD = (
    "motion",
    "from",
    "frames",
    "rest pose",
    "elbow, largest error [deg]",
    "raised, median error [deg]",
    "verdict",
)
BEND, RAISED = 1.0, 25.0
"""Bars [degrees]. Assumed: the chest leans against the line from hips to neck by less than 25 degrees."""


@dataclass
class Joint:
    """A joint of the file, with the columns of its channels."""

    name: str
    parent: int
    offset: Array
    channels: list[str] = field(default_factory=list)
    first: int = 0


def read(path: Path) -> tuple[list[Joint], Array, float]:
    """Joints, values (frames, channels) and the time [s] of a frame of a BVH file."""
    words = path.read_text(encoding="utf-8", errors="replace").split()
    joints: list[Joint] = []
    stack: list[int] = []
    columns, k = 0, 0
    while words[k] != "MOTION":
        word = words[k]
        if word in ("ROOT", "JOINT", "End"):
            joints.append(Joint(words[k + 1], stack[-1] if stack else -1, np.zeros(3)))
            k += 1
        elif word == "{":
            stack.append(len(joints) - 1)
        elif word == "}":
            stack.pop()
        elif word == "OFFSET":
            joints[-1].offset = np.array(words[k + 1 : k + 4], float)
        elif word == "CHANNELS":
            count = int(words[k + 1])
            joints[-1].channels, joints[-1].first = words[k + 2 : k + 2 + count], columns
            columns += count
        k += 1
    frames, time = int(words[k + 2]), float(words[k + 5])
    return joints, np.array(words[k + 6 : k + 6 + frames * columns], float).reshape(frames, columns), time


def places(joints: list[Joint], values: Array) -> dict[str, Array]:
    """Place (frames, 3) of each joint. Position channels that are not zero replace the offset."""
    turns: list[Array] = []
    found: list[Array] = []
    for joint in joints:
        turn, place = np.tile(np.eye(3), (len(values), 1, 1)), np.tile(joint.offset, (len(values), 1))
        for column, channel in enumerate(joint.channels, joint.first):
            axis, own = "XYZ".index(channel[0]), values[:, column]
            if channel.endswith("position"):
                if np.abs(own).max() > 0.0:
                    place[:, axis] = own
                continue
            angle = np.radians(own)
            one = np.tile(np.eye(3), (len(values), 1, 1))
            b, c = (axis + 1) % 3, (axis + 2) % 3
            one[:, b, b] = one[:, c, c] = np.cos(angle)
            one[:, c, b], one[:, b, c] = np.sin(angle), -np.sin(angle)
            turn = turn @ one
        if joint.parent >= 0:
            above = turns[joint.parent]
            place = found[joint.parent] + np.einsum("nij,nj->ni", above, place)
            turn = above @ turn
        turns.append(turn)
        found.append(place)
    return {joint.name: place for joint, place in zip(joints, found, strict=True)}


def between(one: Array, other: Array) -> Array:
    """Angle (n,) [degrees] between two directions (n, 3)."""
    cosine = np.einsum("ni,ni->n", one, other)
    cosine /= np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))


def judge(path: Path, line: dict[str, Any], table: Path) -> tuple[int, float, float]:
    """Frames of a motion, largest error of the elbows' bend, and median error of the upper arms' elevation
    [degrees], of the worse arm."""
    joints, values, _ = read(path)
    at = places(joints, values)
    with table.open() as file:
        rows = list(csv.DictReader(file))
    left_out = len(values) - len(rows)  # a rest pose in the first frame is no motion
    bend, raised = 0.0, 0.0
    low, high = (at[name][left_out:] for name in line["trunk"])
    for side in ("left", "right"):
        shoulder, elbow, wrist = (at[name][left_out:] for name in line[side])
        told = {
            name: np.array([float(row[f"{side}_arm.{name}_deg"]) for row in rows])
            for name in ("shoulder_pitch", "shoulder_roll", "elbow_pitch")
        }
        true = between(elbow - shoulder, wrist - elbow)
        bend = max(bend, float(np.abs(np.abs(told["elbow_pitch"]) - true).max()))
        pitch, roll = np.radians(told["shoulder_pitch"]), np.radians(told["shoulder_roll"])
        elevation = np.degrees(np.arccos(np.clip(np.cos(pitch) * np.cos(roll), -1.0, 1.0)))
        raised = max(raised, float(np.median(np.abs(elevation - between(elbow - shoulder, low - high)))))
    return len(values), bend, raised


def tried(folder: Path, names: list[str]) -> Iterator[tuple[str, ...]]:
    """Yields a row of the table for each file of the list."""
    for line in tomllib.loads((ROOT / "tools" / "motions.toml").read_text())["source"]:
        owner = line["source"].removeprefix("github:").partition("@")[0].replace("/", "+")
        for name in line["files"]:
            path = folder / owner / name
            if not names or path.stem in names:
                yield path.stem, line["source"], *_one(path, line)


def _one(path: Path, line: dict[str, Any]) -> tuple[str, ...]:
    with TemporaryDirectory() as made:
        target = Path(made, "motion.csv")
        command = [*TCI, "gesture", "convert", str(path), str(target), "--json"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        told = json.loads(done.stdout)
        if done.returncode:
            words = "; ".join(fault["message"] for fault in told.get("faults", ())) or told["error"]
            return "", "", "", "", f"refused: {words}"
        frames, bend, raised = judge(path, line, target)
    rest = next((one for one in told["used"] if "rest pose" in one), "")
    verdict = "right" if bend <= BEND and raised <= RAISED else "**wrong**"
    return str(frames), rest, f"{bend:.2f}", f"{raised:.0f}", verdict


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*")
    options = parser.parse_args()
    results = out() / "motions-tried"
    results.mkdir(exist_ok=True)
    for row in tried(options.folder.resolve(), options.names):
        print(" | ".join(row), flush=True)
        (results / f"{row[0]}.json").write_text(json.dumps({"row": row, "commit": commit()}) + "\n")
    found = [json.loads(file.read_text()) for file in sorted(results.glob("*.json"))]
    rows = [one["row"] for one in found]
    right = sum(row[-1] == "right" for row in rows)
    refused = sum(row[-1].startswith("refused") for row in rows)
    (TABLES / "motions-tried.md").write_text(
        f"Of {len(rows)} motions {right} are right, and {refused} are refused with the reason.\n\n"
        f"{markdown(HEAD, rows)}\nMade by `python tools/motions.py DIR` at "
        f"{', '.join(sorted({one['commit'] for one in found}))}.\n"
    )


if __name__ == "__main__":
    main()
