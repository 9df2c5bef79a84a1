"""Tries `tci` on the twenty arms, grippers and hands of `arms.toml`, a list fixed before any of them was
read.

    python tools/arms.py DIR [NAME]... [--quick | --table]

DIR holds the packages, outside the repository (they are downloaded there). Each model goes through new-robot,
check, check --simulate and the five lines of the README, as in `strangers.py`, and is compared with its line,
written by hand, and with MuJoCo or Pinocchio on the untouched file: what its joints do, poses of its links
(0.01 degrees, 0.1 mm), limits, mass (0.1 %), reach (1 mm). If a refusal names an option,
this is tried and told. A part that tells no unit of angles, and is taken with --radians, is read by MuJoCo in
a scene in radians that includes it, as its maker's programs do. Results stay in OUT/arms/NAME.json; --table
makes docs/tables/arms.md of all of them.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from report import ROOT, TABLES, commit, markdown
from strangers import Untouched, advised, five_lines, same_as_file, tci, try_all

from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
from tci.robot.xml import read_robot

LIST = ROOT / "tools" / "arms.toml"
REACH = 1e-3
"""Largest difference [m] of a reach from the line's, which is rounded to mm."""
AXES = {"x": (1.0, 0.0, 0.0), "-y": (0.0, -1.0, 0.0)}


def arm_differences(line: dict[str, Any], robot: Robot, model: Untouched) -> Iterator[str]:
    """What differs between the proposed arm and its line. The line's signs hold for an arm that is stretched
    out forward, on a table: there the pan turns left, the lift raises, the elbow lowers."""
    part = next(one for one in robot.parts if one.kind == "arm")
    joints = ["" if one.servo is None else str(robot.servos[one.servo].joint) for one in part.servos]
    if joints != line["joints"]:
        yield f"{part.name} is {joints}; by hand {line['joints']}"
        return
    assert robot.model is not None
    forward = robot.model.T_LT[:3, 0]
    if np.abs(forward - AXES[line["forward"]]).max() > 1e-6:
        yield f"forward is {np.round(forward, 3)}; by hand {line['forward']}"
    yaw = part.servos[2].fixed if part.servos[2].servo is None else np.pi / 2.0
    maps, signs = joint_map(robot, part.name), []
    for id in (0, 1, 3):
        there = []
        for angle in (0.0, 0.3):
            posture = np.array([0.0, 0.0, yaw, 0.0, 0.0])
            posture[id] += angle
            position = np.zeros(len(robot.servos))
            position[maps.servos] = maps.to_robot(posture, position)
            there.append(position[part.servos[id].servo])
        signs.append(int(np.sign(there[1] - there[0])))
    inward = -1 if part.side == "left" else 1  # a left arm's pitch turns it to the right
    lowers = 1 if yaw > 0.0 else -1
    for name, sign, turned in zip(("pan", "lift", "elbow"), signs, (inward, 1, lowers), strict=True):
        if sign * turned != line[name]:
            yield f"{name} turns with {sign * turned:+d}; by hand {line[name]:+d}"
    for segment, length in zip(part.segments, line["reach"], strict=True):
        if abs(segment.length - length) > REACH:
            yield f"{segment.name} is {segment.length:.4f} m long; by hand {length:.3f}"


def finger_differences(line: dict[str, Any], robot: Robot) -> Iterator[str]:
    """What differs between the proposed fingers and their line: the joints of each, and how the last one
    bends."""
    part = next((one for one in robot.parts if one.kind == "fingers"), None)
    if part is None:
        yield f"no fingers; by hand {', '.join(line['fingers'])}"
        return
    moved = {joint.joint: servo for servo in robot.servos for joint in servo.joints}
    for (name, chain), sign in zip(line["fingers"].items(), line["closes"], strict=True):
        flexion = next(one for one in part.servos if one.name == f"{name}_flexion")
        servo = moved.get(chain[-1])
        if flexion.servo is None or servo is None or servo.index not in flexion.moved:
            yield f"{name}: nothing that bends it moves {chain[-1]}"
            continue
        factor = next((t.factor for t in flexion.terms if t.servo == servo.index), flexion.scale)
        joint = next(one for one in servo.joints if one.joint == chain[-1])
        bends = int(np.sign(factor * joint.multiplier))
        if bends != sign:
            yield f"{name}: {chain[-1]} bends it with {bends:+d}; by hand {sign:+d}"


def jaw_differences(line: dict[str, Any], robot: Robot) -> Iterator[str]:
    """What differs between the proposed jaws and their line: their joints, and the sign with which each
    moves as the flexions of the fingers rise together."""
    part = next((one for one in robot.parts if one.kind == "fingers"), None)
    if part is None:
        yield f"no fingers; by hand {', '.join(line['jaws'])}"
        return
    maps = joint_map(robot, part.name)
    places: list[dict[str, float]] = []
    for step in (0.0, 0.01):
        posture, position = np.array(part.initial_posture), np.zeros(len(robot.servos))
        position[maps.servos] = maps.to_robot(part.initial_posture, position)
        posture[[one.id for one in part.servos if one.name.endswith("_flexion")]] += step
        position[maps.servos] = maps.to_robot(posture, position)
        places.append({
            joint.joint: joint.multiplier * position[servo.index] + joint.offset
            for servo in robot.servos for joint in servo.joints
        })  # fmt: skip
    for joint, sign in zip(line["jaws"], line["closes"], strict=True):
        moved = int(np.sign(places[1].get(joint, 0.0) - places[0].get(joint, 0.0)))
        if moved != sign:
            yield f"{joint} closes with {moved:+d}; by hand {sign:+d}"


def try_one(line: dict[str, Any], folder: Path, *, quick: bool) -> dict[str, Any]:
    """Runs all commands on one model, or with `quick` those that simulate nothing, and returns what they
    said."""
    begin = time.perf_counter()
    file = folder / "pypi" / line["file"]
    target = file.parent / f"tci-{line['name']}.robot.xml"
    result: dict[str, Any] = {"name": line["name"], "commit": commit(), "ran": None, "faults": []}
    words = ["new-robot", str(file), "--name", line["name"], "--out", str(target), "--force"]
    words += ["--side", "right"] if line["kind"] != "arm" else []
    told, result["options"], result["refusals"] = advised(words, {
        "--without-meshes": ["--without-meshes"], "--elbow": ["--elbow", str(line.get("elbow", 1))],
        "--no-sleeves": ["--no-sleeves"], "--radians": ["--radians"],
    })  # fmt: skip
    if told is not None:
        robot, model = read_robot(target), Untouched(file, radians="--radians" in result["options"])
        links = [name for name in (*line.get("joints", ()), *line.get("jaws", ())) if name]
        wrong = list(arm_differences(line, robot, model)) if line["kind"] == "arm" else []
        wrong += finger_differences(line, robot) if line["kind"] == "hand" else []
        wrong += jaw_differences(line, robot) if line["kind"] == "gripper" else []
        result["faults"] = [*wrong, *same_as_file(robot, model, links, line["mass"])]
        checked, error = tci("check", *([] if quick else ["--simulate"]), str(target))
        result["faults"] += [error] if checked is None else checked["faults"]
        if not quick:
            result["five_lines"], result["ran"] = five_lines(
                robot, target, "WithdrawalReflex" if line["kind"] == "arm" else "FingerReflex"
            )
    result["whole"] = told is not None and not result["faults"] and result["ran"] is not False
    result["seconds"] = round(time.perf_counter() - begin, 1)
    return result


def said(result: dict[str, Any]) -> str:
    if result["whole"]:
        return "agrees"
    if result["refusals"] and not result["faults"] and result["ran"] is None:
        return f"refused: {result['refusals'][-1]}"
    faults = [*result["faults"], *([f"five lines: {result['five_lines']}"] if result["ran"] is False else [])]
    return "; ".join(faults)


def table(lines: list[dict[str, Any]], results: dict[str, dict[str, Any]]) -> None:
    """Writes docs/tables/arms.md from the stored results."""
    rows = [
        (line["name"], line["kind"], line["source"], " ".join(results[line["name"]]["options"]) or "none",
         said(results[line["name"]]).replace("|", "/"))
        for line in lines
    ]  # fmt: skip
    whole = sum(results[line["name"]]["whole"] for line in lines)
    commits = ", ".join(sorted({one["commit"] for one in results.values()}))
    words = f"{whole} of {len(lines)} run to the end and agree with their line and with the untouched file."
    text = markdown(("name", "kind", "source", "options", "result"), rows)
    (TABLES / "arms.md").write_text(f"{text}\n\n{words} Measured at {commits}.\n")


def main() -> None:
    try_all(__doc__, LIST, try_one, said, table)


if __name__ == "__main__":
    main()
