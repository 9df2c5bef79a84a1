"""The depth by which skin enters a touching object is that of a dense search along the path."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import tci
from helpers.pressing import with_pad
from tci.body.generic_body import GenericBody
from tci.body.retreat import OBJECT
from tci.messages import Mode
from tci.robot.joint_map import joint_map
from tci.testing import perception

CORNER = {
    "centre": np.array([-0.01852979, -0.01124647, -0.00217569]),
    "normal": np.array([-0.87063325, -0.43875588, -0.22246576]),
}
"""A pad that stands across an iCub's shank."""
SAMPLES = 100
SPAN = np.deg2rad(25.0)
"""Angle [rad] of each motion. Each motion moves one joint only, so its path is known."""


def test_the_depth_is_that_of_a_dense_search(tmp_path: Path) -> None:
    robot = tci.load_robot("icub-whole")
    robot = with_pad(robot, "right_leg", "r_lower_leg_skin_35", tmp_path, segment="shank", **CORNER)
    body, joints = GenericBody(robot), joint_map(robot, "right_leg")
    chain, surfaces = body.skin.kinematics, body.skin.surfaces
    seen = perception(robot, "pad", taxel=8)
    (contact,) = seen.contacts
    centre, start = contact.p_T + OBJECT * contact.n_T, np.array(seen.posture["right_leg"])
    assert seen.joints is not None
    depths = []
    for joint in range(4):
        for angle in (SPAN, -SPAN):
            target = start + angle * np.eye(len(start))[joint]
            way = np.array([start + share * (target - start) for share in np.linspace(0.0, 1.0, SAMPLES)])
            entered = body.retreat(seen, "right_leg", target, Mode.POSITION)[2]
            assert entered.shape == (6, 1)
            angles = np.tile(seen.joints.position, (SAMPLES, 1))
            lower, upper = ([getattr(one.limits, end) for one in robot.servos] for end in ("lower", "upper"))
            angles[:, joints.servos] = [joints.to_robot(one, seen.joints.position) for one in way]
            angles = np.clip(angles, np.array(lower, float), np.array(upper, float))
            deepest = 0.0
            for patch in (one for one in robot.patches if one.part == "right_leg"):
                poses = [chain.poses(one, (patch.link,))[patch.link] for one in angles]
                inside = np.array([T[:3, :3].T @ (centre - T[:3, 3]) for T in poses])
                gaps = np.linalg.norm(surfaces[patch.name].project(inside)[0] - inside, axis=1)
                deepest = max(deepest, min(OBJECT, gaps[0]) - gaps.min())
            depths.append((joint, float(entered.max()), deepest))
    print(*depths, sep="\n")
    for _, found, deepest in depths:
        # The kernel examines points of the path that are at most half a radius apart.
        assert deepest - OBJECT / 4.0 <= found <= deepest + 5e-4
    assert {found > 2e-3 for _, found, _ in depths} == {True, False}
