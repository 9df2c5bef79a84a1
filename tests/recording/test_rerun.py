"""A recording opened in rerun, an independent viewer with its own reader of joint and skin messages."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import numpy as np

from helpers.peers import peer_python
from helpers.recorded import record_poke

SHOWN = 4
"""Number of values per row that are printed completely, because rerun abbreviates long rows."""
ROW = re.compile(r"row_\w+ [^\[]*\[((?:[-0-9.e]+, ){4})")


def rerun(home: Path, *words: str) -> str:
    """Returns the output of rerun's command-line program."""
    program = Path(peer_python("rerun")).with_name("rerun")
    environment = {**os.environ, "HOME": str(home), "NO_COLOR": "1"}
    command = [str(program), *words]
    answer = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout + answer.stderr


def test_rerun_reads_a_recording_without_our_code(tmp_path: Path) -> None:
    rerun(tmp_path, "analytics", "disable")
    ticks = record_poke(tmp_path / "poke.mcap", duration=0.6)
    checked = rerun(tmp_path, "mcap", "check", str(tmp_path / "poke.mcap"))
    for topic in ("/joint_states", "/skin/left_forearm", "/skin/points", "/tci/decision"):
        assert re.search(rf"ok +\d+ +\d+ +{topic} ", checked), checked
    told = rerun(tmp_path, "mcap", "convert", str(tmp_path / "poke.mcap"), "-o", str(tmp_path / "poke.rrd"))
    assert "/skin/points" in told
    printed = rerun(
        tmp_path, "rrd", "print", "-vvv", "--entity", "/joint_states/position", str(tmp_path / "poke.rrd")
    )
    rows = [[float(value) for value in row.split(",")[:SHOWN]] for row in ROW.findall(printed)]
    np.testing.assert_array_equal(rows, [tick.reading.joints.position[:SHOWN] for tick in ticks])
    assert np.ptp(rows, axis=0).max() > 0.01, "the arm moves"
    points = rerun(tmp_path, "rrd", "print", "-vv", "--entity", "/skin/points", str(tmp_path / "poke.rrd"))
    assert "Points3D" in points
