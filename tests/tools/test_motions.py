"""The judge of motions tells what differs, and finds nothing in what is right."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

from helpers import ROOT
from helpers.motion_capture import CONVENTIONS, bvh
from tci.gestures.bvh import read_bvh
from tci.gestures.files import write_csv


@pytest.mark.parametrize("name", ["CMU", "Unreal"])
def test_a_wrong_elbow_and_a_raised_arm_are_found(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    judge = importlib.import_module("motions").judge
    angles = np.deg2rad([[20, 10, 5, 40, 0], [25, 12, 5, 50, 0], [30, 15, 5, 60, 0]])
    convention, motion, table = CONVENTIONS[name], tmp_path / "a.bvh", tmp_path / "a.csv"
    motion.write_text(bvh(angles, rest=0.0, convention=convention))
    imported = read_bvh(motion)
    write_csv(imported.gesture, table, imported.names)
    sides = {
        side: [one.format(side=side.title(), s=side[0], S=side[0].upper()) for one in convention.arm]
        for side in ("left", "right")
    }
    line = {**sides, "trunk": ["Hips", "Spine"]}
    frames, bend, raised = judge(motion, line, table)
    assert (frames, round(bend, 2), round(raised, 1)) == (3, 0.0, 0.0)
    head, *rows = table.read_text().splitlines()
    for column, off in (
        ("left_arm.elbow_pitch_deg", (5.0, 0.0)),
        ("right_arm.shoulder_pitch_deg", (0.0, 20.0)),
    ):
        place = head.split(",").index(column)
        changed = [row.split(",") for row in rows]
        for row in changed:
            row[place] = str(float(row[place]) + max(off))
        table.write_text("\n".join([head, *map(",".join, changed)]))
        _, bend, raised = judge(motion, line, table)
        assert bend == pytest.approx(off[0], abs=0.01)
        assert raised == pytest.approx(off[1], abs=5.0)
