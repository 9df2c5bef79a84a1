"""Chains of the run-time query, built in OROCOS KDL by another process with Debian's python3-pykdl.

The processes exchange the JSON of `tci describe ROBOT --format kdl`; the lines of docs/kinematics.md build
the chain from this JSON.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from helpers import ROOT
from helpers.moving import random_postures, robot_and_kinematics
from helpers.peers import debian_python, needs_debian_module
from tci.exports.chain import ChainSegment
from tci.exports.facts import query
from tci.robot.inverse import InverseKinematics

COUNT = 200
PAGE = ROOT / "docs" / "kinematics.md"
KDL = """
import json, sys
import PyKDL as kdl

def frame(rows):
    R = kdl.Rotation(*[value for row in rows[:3] for value in row[:3]])
    return kdl.Frame(R, kdl.Vector(*[row[3] for row in rows[:3]]))

def angles(values):
    q = kdl.JntArray(len(values))
    for i, value in enumerate(values):
        q[i] = value
    return q

def matrix(pose):
    return [[pose.M[i, j] for j in range(3)] + [pose.p[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]

request = json.load(sys.stdin)
exec(request["documented"])
forward, jacobian = kdl.ChainFkSolverPos_recursive(chain), kdl.ChainJntToJacSolver(chain)
inverse = kdl.ChainIkSolverPos_LMA(chain, eps=1e-12)
answers = []
for values in request["postures"]:
    q, pose, J = angles(values), kdl.Frame(), kdl.Jacobian(chain.getNrOfJoints())
    forward.JntToCart(q, pose)
    jacobian.JntToJac(q, J)
    rows = [[J[i, j] for j in range(J.columns())] for i in range(6)]
    answers.append({"pose": matrix(pose), "jacobian": rows})
solved = []
for case in request["targets"]:
    found = angles(case["start"])
    status = inverse.CartToJnt(angles(case["start"]), frame(case["target"]), found)
    solved.append({"status": status, "angles": [found[i] for i in range(found.rows())]})
json.dump({"poses": answers, "solved": solved, "mass": sum(
    chain.getSegment(i).getInertia().getMass() for i in range(chain.getNrOfSegments()))}, sys.stdout)
"""

PARTS = [(name, part) for name in ("nao", "icub") for part in ("left_arm", "right_arm", "head")]


def documented_lines(folder: Path, part: str, segments: tuple[ChainSegment, ...]) -> str:
    """Executes the lines of docs/kinematics.md that build a chain from the JSON of this part, and returns the
    result."""
    file = folder / "chains.json"
    file.write_text(json.dumps({part: [segment.model_dump(mode="json") for segment in segments]}))
    lines = PAGE.read_text().split("```python\n")[1].split("```")[0]
    assert lines.count('"nao.json"') == lines.count('"left_arm"') == 1
    return lines.replace('"nao.json"', repr(str(file))).replace('"left_arm"', repr(part))


@pytest.mark.parametrize(("name", "part"), PARTS)
def test_kdl_agrees_on_poses_jacobians_and_inverse_kinematics(name: str, part: str, tmp_path: Path) -> None:
    needs_debian_module("PyKDL", "python3-pykdl")
    robot, kinematics = robot_and_kinematics(name)
    facts = query(robot)
    segments = facts.chains[part]
    servos = [segment.servo for segment in segments if segment.servo is not None]
    tip = segments[-1].name
    postures = random_postures(robot, COUNT, seed=10)
    inverse = InverseKinematics(robot, kinematics, tip)
    targets = [kinematics.poses(posture, [tip])[tip] for posture in postures[:50]]
    # KDL ignores joint limits, so it starts at TCI's solution, which it must confirm.
    ours = [inverse.solve(target, posture + 0.05) for target, posture in zip(targets, postures, strict=False)]
    request = {
        "documented": documented_lines(tmp_path, part, segments),
        "postures": postures[:, servos].tolist(),
        "targets": [
            {"target": target.tolist(), "start": (posture[servos] + 0.05).tolist()}
            for target, posture in zip(targets, postures, strict=False)
        ],
    }
    answer = json.loads(debian_python(KDL, json.dumps(request)))
    pose_error = jacobian_error = 0.0
    for posture, other in zip(postures, answer["poses"], strict=True):
        T_TL, jacobian = kinematics.pose_and_jacobian(posture, tip)
        pose_error = max(pose_error, np.abs(T_TL - other["pose"]).max())
        jacobian_error = max(jacobian_error, np.abs(jacobian[:, servos] - other["jacobian"]).max())
    print(f"{name} {part}: poses {pose_error:.0e}, Jacobians {jacobian_error:.0e}")
    assert pose_error <= 1e-9
    assert jacobian_error <= 1e-9
    reached = 0
    for target, own, other in zip(targets, ours, answer["solved"], strict=True):
        assert own.reached
        position = np.array(own.position)
        position[servos] = other["angles"]
        there = kinematics.poses(position, [tip])[tip]
        if other["status"] >= 0:
            reached += 1
            assert np.abs(there - target).max() < 1e-4
    assert reached >= 0.9 * len(targets)
    masses = {link.name: link.inertia.mass for link in facts.links if link.inertia is not None}
    assert answer["mass"] == pytest.approx(sum(masses.get(segment.name, 0.0) for segment in segments))
