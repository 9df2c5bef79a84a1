"""Tries `tci` on the thirty public models of `strangers.toml`, a list fixed before any of them was read.

    python tools/strangers.py DIR [NAME]... [--quick | --table]

DIR holds the models, outside the repository: DIR/OWNER+NAME is a checkout of each GitHub repository of the
list, and what is on PyPI is downloaded to DIR/pypi. Each model goes through new-robot, check,
check --simulate and the five lines of the README. Then the description is compared with the list,
written by hand, and with MuJoCo (MJCF) or Pinocchio (URDF) on the untouched file: poses of the arms'
links (0.01 degrees, 0.1 mm), limits, masses (0.1 %). If new-robot refuses a model and names an option, the
option is tried with the value of the list; that is one more line in the result. If it names numbers of the
file, a copy with these is tried too and told, but the model counts as refused. Where no skin is on an arm,
the five lines run after --sleeves. --quick leaves out what is simulated: check --simulate and the five
lines. Results stay in OUT/strangers/NAME.json; --table makes docs/tables/strangers.md of all of them.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import time
import tomllib
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
from advice import followed
from report import ROOT, TABLES, commit, markdown, out

from tci.capabilities.capability import lacks
from tci.capabilities.withdrawal import WithdrawalReflex
from tci.messages.frames import Array
from tci.robot.description import Robot
from tci.robot.joint_map import joint_map
from tci.robot.kinematics import KinematicChain
from tci.robot.model_file import compiled, load_spec
from tci.robot.xml import read_robot

LIST = ROOT / "tools" / "strangers.toml"
TCI = (sys.executable, "-c", "from tci.cli.main import main; main()")
FIVE_LINES = """
import sys, tci, tci.capabilities
with tci.connect(sys.argv[1], "sim") as driver:
    driver.world.finger.poke(sys.argv[2], int(sys.argv[3]))
    print(tci.run(driver, getattr(tci.capabilities, sys.argv[4])(), duration=1.0))
"""
POSTURES, SEED = 20, 46
ANGLE, PLACE, MASS, LIMIT = np.deg2rad(0.01), 1e-4, 1e-3, 1e-4
"""Bars: angle [rad] and place [m] of a link, share of the mass, position limit [rad]."""


class Untouched:
    """The model as MuJoCo or Pinocchio reads the maker's own file."""

    def __init__(self, file: Path, *, radians: bool = False) -> None:
        self.limits: dict[str, tuple[float, float, float, float]] = {}
        """Lower and upper limit [rad], torque and speed limit of each joint; infinite if unknown."""
        if file.suffix.lower() == ".urdf":
            text = file.read_text(encoding="utf-8")
            for name in ("effort", "velocity"):  # Pinocchio refuses a joint that leaves these out
                text = re.sub(rf"<limit (?![^>]*{name})", f'<limit {name}="0" ', text)
            self._pin = pinocchio.buildModelFromXML(text)
            self._pin_data = self._pin.createData()
            self.mass = float(sum(one.mass for one in self._pin.inertias))
            for index, name in enumerate(self._pin.names[1:], 1):
                v, q, turns = self._pin.idx_vs[index], self._pin.idx_qs[index], self._pin.nqs[index] == 2
                low = -np.inf if turns else self._pin.lowerPositionLimit[q]
                high = np.inf if turns else self._pin.upperPositionLimit[q]
                self.limits[name] = (low, high, self._pin.effortLimit[v], self._pin.velocityLimit[v])
        else:
            self._pin = None
            self._model = _in_radians(file) if radians else mujoco.MjModel.from_xml_path(str(file))
            self._data = mujoco.MjData(self._model)
            moving = set(self._model.body_rootid[self._model.jnt_bodyid])
            tops = [index for index in range(1, self._model.nbody) if self._model.body_parentid[index] == 0]
            self.mass = float(sum(self._model.body_subtreemass[top] for top in tops if top in moving))
            for index in range(self._model.njnt):
                bounded = self._model.jnt_limited[index]
                low, high = self._model.jnt_range[index] if bounded else (-np.inf, np.inf)
                self.limits[self._model.joint(index).name] = (float(low), float(high), np.inf, np.inf)

    def pose(self, angles: dict[str, float], link: str, base: str) -> Array:
        """Returns the pose (4, 4) [m] of `link` in the frame of `base`."""
        if self._pin is None:
            self._data.qpos[:] = 0.0
            for index in range(self._model.njnt):
                if self._model.jnt_type[index] == mujoco.mjtJoint.mjJNT_FREE:
                    self._data.qpos[self._model.jnt_qposadr[index] + 3] = 1.0
            for name, angle in angles.items():
                self._data.qpos[self._model.joint(name).qposadr[0]] = angle
            mujoco.mj_kinematics(self._model, self._data)
            poses = []
            for name in (base, link):
                T = np.eye(4)
                T[:3, :3] = self._data.body(name).xmat.reshape(3, 3)
                T[:3, 3] = self._data.body(name).xpos
                poses.append(T)
        else:
            q = pinocchio.neutral(self._pin)
            for name, angle in angles.items():
                index = self._pin.getJointId(name)
                place = self._pin.idx_qs[index]
                if self._pin.nqs[index] == 2:
                    q[place : place + 2] = np.cos(angle), np.sin(angle)
                else:
                    q[place] = angle
            pinocchio.framesForwardKinematics(self._pin, self._pin_data, q)
            poses = [self._pin_data.oMf[self._frame(name)].homogeneous for name in (base, link)]
        return np.asarray(np.linalg.inv(poses[0]) @ poses[1])

    def _frame(self, link: str) -> int:
        return int(self._pin.getFrameId(link, pinocchio.FrameType.BODY))


def _in_radians(file: Path) -> mujoco.MjModel:
    """MuJoCo's reading of a part that tells no unit of angles, in a scene in radians that includes it."""
    scene = file.with_name("tci-scene-in-radians.xml")
    scene.write_text(f'<mujoco><compiler angle="radian"/><include file="{file.name}"/></mujoco>')
    return mujoco.MjModel.from_xml_path(str(scene))


def differences(line: dict[str, Any], robot: Robot, file: Path) -> Iterator[str]:
    """Yields what differs between a description, the line written by hand and the untouched file."""
    model = Untouched(file)
    for side, sign in zip(("left", "right"), line["elbow"], strict=True):
        part = robot.part(f"{side}_arm")
        joints = ["" if one.servo is None else str(robot.servos[one.servo].joint) for one in part.servos]
        if joints != line[side]:
            yield f"{part.name} is {joints}; by hand {line[side]}"
            return
        elbow, bent = part.servos[3].servo, []
        for angle in (0.0, 0.5):
            posed, position = joint_map(robot, part.name), np.zeros(len(robot.servos))
            position[posed.servos] = posed.to_robot(np.array([0.0, 0.0, 0.0, angle, 0.0]), position)
            bent.append(position[elbow])
        moved = bent[1] - bent[0]
        if np.sign(moved) != sign:
            yield f"{part.name}: the elbow bends with {moved:+.2f}; by hand {sign:+d}"
    moved = [name for side in ("left", "right") for name in line[side] if name]
    yield from same_as_file(robot, model, moved, line["mass"])


def same_as_file(robot: Robot, model: Untouched, joints: Sequence[str], by_hand: float) -> Iterator[str]:
    """Yields what differs between a description and the untouched file: poses of the links that `joints`
    move, limits, and the mass, also from that `by_hand` [kg]."""
    own = robot.model
    assert own is not None
    chain, rng = KinematicChain(robot), np.random.default_rng(SEED)
    bare = compiled(load_spec(own), own)
    links = [bare.body(int(bare.joint(name).bodyid[0])).name for name in joints]
    low = np.array(
        [-1.0 if one.limits.lower is None else max(one.limits.lower, -3.0) for one in robot.servos]
    )
    high = np.array([1.0 if one.limits.upper is None else min(one.limits.upper, 3.0) for one in robot.servos])
    turned = shifted = 0.0
    for _ in range(POSTURES):
        position = rng.uniform(low, high)
        angles = {
            joint.joint: joint.multiplier * position[servo.index] + joint.offset
            for servo in robot.servos for joint in servo.joints
        }  # fmt: skip
        poses = chain.poses(position, [own.torso_link, *links])
        base = np.linalg.inv(poses[own.torso_link])
        for link in links:
            away = np.linalg.inv(model.pose(angles, link, own.torso_link)) @ base @ poses[link]
            turned = max(turned, float(np.arccos(np.clip((np.trace(away[:3, :3]) - 1) / 2, -1, 1))))
            shifted = max(shifted, float(np.linalg.norm(away[:3, 3])))
    if turned > ANGLE or shifted > PLACE:
        yield f"poses differ by {np.rad2deg(turned):.3f} degrees, {1e3 * shifted:.2f} mm"
    for servo in robot.servos:
        first = servo.joints[0] if servo.joints else None
        if first is not None and first.joint in model.limits:
            yield from _limits(servo, first, model.limits[first.joint])
    mass = float(bare.body_mass.sum())
    for other, whose in ((model.mass, "of the file"), (by_hand, "by hand")):
        if abs(mass - other) > MASS * other:
            yield f"mass {mass:.3f} kg; {whose} {other:.3f} kg"


def _limits(servo: Any, first: Any, limits: tuple[float, float, float, float]) -> Iterator[str]:
    """What differs between limits of a servo and those of its first joint in the file. One that slides has
    m, m/s and N there, of which the servo's pinion makes rad, rad/s and N m."""
    low, high, torque, speed = limits
    ours, assumed = servo.limits, servo.limits.assumed
    if first.slides:
        low, high = sorted((end - first.offset) / first.multiplier for end in (low, high))
        torque, speed = torque * abs(first.multiplier), speed / abs(first.multiplier)
    for name, mine, theirs, wider in (("lower", ours.lower, low, -1.0), ("upper", ours.upper, high, 1.0)):
        if mine is None or not np.isfinite(theirs):
            continue
        told = name in assumed and (mine - theirs) * wider < 0.0  # narrower, and new-robot says so
        if abs(mine - theirs) > LIMIT and not told:
            yield f"{first.joint}: {name} limit {mine:.4f}; of the file {theirs:.4f}"
    for name, mine, theirs in (("torque", ours.torque, torque), ("velocity", ours.velocity, speed)):
        known = np.isfinite(theirs) and mine is not None and name not in assumed
        if known and abs(mine - theirs) > MASS * max(theirs, 1e-3):
            yield f"{first.joint}: {name} limit {mine:.4f}; of the file {theirs:.4f}"


def tci(*words: str, limit: float = 600.0) -> tuple[Any, str]:
    """Returns the JSON of a command, or None with its error."""
    try:
        done = subprocess.run(
            [*TCI, *words, "--json"], capture_output=True, text=True, timeout=limit, check=False
        )
    except subprocess.TimeoutExpired:
        return None, f"took longer than {limit:g} s"
    try:
        told = json.loads(done.stdout)
    except json.JSONDecodeError:
        lines = [line for line in done.stderr.splitlines() if line.strip() and "WARNING" not in line]
        return None, " ".join(lines)[-2000:] or f"exit status {done.returncode}"
    if "error" not in told:
        return told, ""
    faults = [fault["message"] for fault in told.get("faults", ())]
    return None, "; ".join(faults) or json.dumps(told)


def _proposed(line: dict[str, Any], file: Path, target: Path) -> tuple[Any, list[str], list[str]]:
    advice = {
        "--without-meshes": ["--without-meshes"],
        "--arms": ["--arms", f"{line['left'][0]},{line['right'][0]}"],
        "--elbow": ["--elbow", str(line["elbow"][0])],
        "--fingers none": ["--fingers", "none"],
    }
    words = ["new-robot", str(file), "--name", line["name"], "--out", str(target), "--force"]
    return advised(words, advice)


def advised(words: Sequence[str], advice: dict[str, list[str]]) -> tuple[Any, list[str], list[str]]:
    """Runs new-robot as `words` say, and once more for each option of `advice` that a refusal names. Returns
    its output, the options and the refusals."""
    options: list[str] = []
    refusals: list[str] = []
    while True:
        told, error = tci(*words, *options)
        if told is not None:
            return told, options, refusals
        refusals.append(" ".join(error.split()))
        offered = next(
            (more for name, more in advice.items() if name in error and name.split()[0] not in options), None
        )
        if offered is None:
            return None, options, refusals
        options += offered


def try_one(line: dict[str, Any], folder: Path, *, quick: bool) -> dict[str, Any]:
    """Runs all commands on one model, or with `quick` those that simulate nothing, and returns what they
    said."""
    begin = time.perf_counter()
    file = folder / _place(line["source"]) / line["file"]
    target = file.parent / f"tci-{line['name']}.robot.xml"
    result: dict[str, Any] = {"name": line["name"], "commit": commit(), "file": line["file"]}
    if not file.is_file():
        return result | {"missing": str(file)}
    told, result["options"], result["refusals"] = _proposed(line, file, target)
    if told is None and (copied := followed(file, result["refusals"][-1])) is not None:
        mended = line | {"file": str(Path(line["file"]).with_name(copied[0].name))}
        result["advised"] = {"what": copied[1]} | try_one(mended, folder, quick=quick)
    if told is not None:
        result["told"] = told
        robot = read_robot(target)
        result["wrong"] = list(differences(line, robot, file))
        result["simulated"], result["five_lines"], result["ran"] = None, "", None
        commands = [("check", ["check"]), ("simulated", ["check", "--simulate"])]
        for name, words in commands[: 1 if quick else 2]:
            checked, error = tci(*words, str(target))
            faults = [error] if checked is None else checked["faults"]
            result[name] = {"faults": faults, "doubts": [] if checked is None else checked["doubts"]}
        if not quick:
            if not lacks(WithdrawalReflex(), robot):
                result["five_lines"], result["ran"] = five_lines(robot, target)
            else:  # the reflex of the five lines says that it needs skin on an arm
                worn = target.with_name(f"tci-{line['name']}-sleeves.robot.xml")
                words = ["new-robot", str(file), "--name", line["name"], "--out", str(worn), "--force"]
                dressed, error = tci(*words, *result["options"], "--sleeves")
                result["five_lines"], result["ran"] = (
                    (error, False) if dressed is None else five_lines(read_robot(worn), worn)
                )
                result["five_lines_after"] = "--sleeves"
    result["whole"] = told is not None and not _faults(result) and result["ran"] is not False
    result["seconds"] = round(time.perf_counter() - begin, 1)
    return result


def _faults(result: dict[str, Any]) -> list[str]:
    """What a description that new-robot wrote lacks; the simulated check repeats the faults of the other."""
    return [*result["wrong"], *(result["simulated"] or result["check"])["faults"]]


def five_lines(robot: Robot, target: Path, reflex: str = "WithdrawalReflex") -> tuple[str, bool]:
    arms = [one for one in robot.patches if robot.part(one.part).kind == "arm"]  # what this reflex answers
    patches = [one for one in arms if one.name.endswith("_forearm")] or arms or list(robot.patches)
    if not patches:
        return "no skin", False
    words = [sys.executable, "-c", FIVE_LINES, str(target), patches[0].name, str(patches[0].channels // 2)]
    words.append(reflex)
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    said = done.stdout.strip() or (done.stderr.strip().splitlines() or ["nothing"])[-1]  # no traceback
    return said, done.returncode == 0 and "; moved" in said


def _place(source: str) -> str:
    kind, _, name = source.partition(":")
    return "pypi" if kind == "pypi" else name.partition("@")[0].replace("/", "+")


def fetch_pypi(lines: Sequence[dict[str, Any]], folder: Path) -> None:
    """Downloads the packages of the list that lie on PyPI, and unpacks them to `folder`/pypi."""
    for package in sorted(
        {line["source"].removeprefix("pypi:") for line in lines if "pypi:" in line["source"]}
    ):
        wheels, place = folder / "wheels" / package, folder / "pypi"
        if not list(wheels.glob("*.whl")):
            words = ["-m", "pip", "download", "--no-deps", "--only-binary=:all:", "-d", str(wheels), package]
            subprocess.run([sys.executable, *words], check=True)
            for wheel in wheels.glob("*.whl"):
                zipfile.ZipFile(wheel).extractall(place)


def try_all(
    words: str | None,
    models: Path,
    try_one: Callable[..., dict[str, Any]],
    said: Callable[[dict[str, Any]], str],
    table: Callable[[list[dict[str, Any]], dict[str, dict[str, Any]]], None],
) -> None:
    """The program of a list of models.

    Args:
        words: What `--help` says.
        models: The list; results are kept in a folder of OUT of its name.
        try_one: Tries a line of the list in a folder of models, `quick` or not; its result says if it is
            `whole`.
        said: A line about a result.
        table: Writes the table of all lines and their results.
    """
    parser = argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--table", action="store_true")
    asked = parser.parse_args()
    every = tomllib.loads(models.read_text())["model"]
    lines = [line for line in every if not asked.names or line["name"] in asked.names]
    folder, target = asked.folder.resolve(), out() / models.stem
    target.mkdir(exist_ok=True)
    if asked.table:
        table(every, {file.stem: json.loads(file.read_text()) for file in target.glob("*.json")})
        return
    fetch_pypi(lines, folder)
    whole = 0
    for line in lines:
        result = try_one(line, folder, quick=asked.quick)
        (target / f"{line['name']}.json").write_text(json.dumps(result, indent=1))
        whole += bool(result.get("whole"))
        print(f"{line['name']}: {said(result)}", flush=True)
    print(f"{whole} of {len(lines)} run to the end and agree")


def main() -> None:
    try_all(__doc__, LIST, try_one, lambda result: "whole" if result.get("whole") else _what(result), table)


def _what(result: dict[str, Any]) -> str:
    if "missing" in result:
        return f"not there: {result['missing']}"
    if "told" not in result:
        return f"refused: {result['refusals'][-1]}{_advised(result.get('advised'))}"
    faults = _faults(result)
    return "; ".join([*faults, f"five lines: {result['five_lines']}"] if result["ran"] is False else faults)


def _advised(after: dict[str, Any] | None) -> str:
    """What comes of the advice of a refusal."""
    if after is None or "told" not in after:
        return "" if after is None else f"; its advice does not work: {_what(after)}"
    ran = "" if after["ran"] is None else f", the five lines {'moved' if after['ran'] else 'failed'}"
    proved = "" if not after["simulated"] else f", check --simulate: {_short(after['simulated']['faults'])}"
    return f"; with its advice, {after['what']}: proposed{proved}{ran}"


def table(lines: Sequence[dict[str, Any]], results: dict[str, dict[str, Any]]) -> None:
    """Writes docs/tables/strangers.md from the stored results."""
    rows, agree, whole, simulated = [], 0, 0, 0
    for line in lines:
        result = results.get(line["name"], {})
        options = " ".join(result.get("options", ()))
        what = "agrees" if result.get("whole") else f"**{_what(result)}**" if result else "not tried"
        proved = "not tried" if not result.get("simulated") else _short(result["simulated"]["faults"])
        ran = {None: "not tried", True: "moved", False: "**no**"}[result.get("ran")]
        ran += f" after {result['five_lines_after']}" if "five_lines_after" in result else ""
        kind = "URDF" if line["file"].lower().endswith("urdf") else "MJCF"
        rows.append((line["name"], line["maker"], kind, line["source"], options or "none", what, proved, ran))
        agree += "told" in result and not (result["wrong"] or result["check"]["faults"])
        simulated += bool(result.get("simulated"))
        whole += bool(result.get("whole") and result["ran"])
    head = ("name", "maker", "model", "source", "options", "proposed", "check --simulate", "five lines")
    commits = ", ".join(sorted({one["commit"] for one in results.values()}))
    words = (
        f"{agree} of {len(lines)} proposals agree with the list and with the untouched file, and pass "
        f"`check`. {simulated} models were also simulated, with `check --simulate` and the five lines; "
        f"{whole} of them ran to the end."
    )
    made = f"Made by `python tools/strangers.py DIR` at {commits} with MuJoCo {mujoco.__version__}."
    (TABLES / "strangers.md").write_text(f"{words}\n\n{markdown(head, rows)}\n{made}\n")


def _short(faults: Sequence[str]) -> str:
    return f"{len(faults)} faults: {faults[0].split(';')[0]}" if faults else "proved"


if __name__ == "__main__":
    main()
